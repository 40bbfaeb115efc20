"""A viewer on a host of its own: `viewing_process.py JOINING`.

Watches until its input ends, and prints how many blocks it saw.
"""

from __future__ import annotations

import json
import sys

from duralab_bus import BusConfig, open_bus
from duralab_proto.keys import ANY
from duralab_proto.v1 import iterator_pb2, rig_pb2


def main() -> None:
    blocks: set[tuple[str, int, int]] = set()
    with open_bus(BusConfig.model_validate(json.loads(sys.argv[1])), service="viewer") as bus:
        signals = bus.subscribe(
            bus.keys.rig_signal(ANY, ANY), rig_pb2.SignalBlock, lambda item: blocks.add(item.position), repair=True
        )
        events = bus.subscribe(bus.keys.campaign_event(ANY), iterator_pb2.CampaignEvent, lambda _item: None)
        sys.stdin.read()
        for subscription in (signals, events):
            subscription.close()
    sys.stdout.write(f"{len(blocks)}\n")


if __name__ == "__main__":
    main()
