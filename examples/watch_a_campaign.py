"""Watch a lab live while a campaign runs: rig states, played signals, error after every playback.

python examples/watch_a_campaign.py [ENDPOINT]
"""

import sys
import threading
from pathlib import Path

import duralab

campaign = Path(__file__).with_name("short_campaign.yaml")

with duralab.connect(*sys.argv[1:2]) as lab, lab.watch(timeout_seconds=60.0) as events:
    # Usually another client starts the campaign; here a thread does.
    threading.Thread(target=lab.run, args=(campaign,), kwargs={"out": "out/watched"}, daemon=True).start()
    largest = 0.0
    for event in events:
        match event:
            case duralab.SignalsEvent(rig="front_axle_compliant", response=response):
                largest = max(largest, abs(response.samples).max())
            case duralab.RigEvent(state):
                print(state)
            case duralab.CampaignEvent(progress=progress, ended=ended):
                print(progress)
                if ended:
                    break
    print(progress.iterations)
    print(f"largest force {largest:.0f} N; {events.dropped} events dropped")
