"""Run a campaign from Python: change settings of its file, follow and judge it, save report and drive file.

python examples/run_a_campaign.py [ENDPOINT]
"""

import sys
from pathlib import Path

import duralab
from duralab.formats import write_signals

campaign = duralab.load_campaign(Path(__file__).with_name("short_campaign.yaml"))
campaign = campaign.model_copy(update={"seed": 7, "stop": campaign.stop.model_copy(update={"iterations": 4})})

with duralab.connect(*sys.argv[1:2]) as lab:
    result = lab.run(campaign, out="out/run", on_progress=print, timeout_seconds=600.0)

print(result)
best = result.recording.playback(result.status.best_iteration)
print(write_signals(best.drive, "out/run/best.drv", overwrite=True))
print(result.report())
sys.exit(result.verdict.judgement is not duralab.Judgement.REACHED)
