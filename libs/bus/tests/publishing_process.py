"""A publisher as a process of its own, so that a test can kill it: numbered blocks, kept in a folder until marked."""

import json
import sys
import time
from pathlib import Path

import duralab_bus
from duralab_proto.v1 import rig_pb2

settings = json.loads(sys.argv[1])
config = duralab_bus.BusConfig(connect=(settings["endpoint"],), mode=settings.get("mode", "peer"))
with duralab_bus.open_bus(config, service="rig_sim") as bus:
    spools = duralab_bus.SpoolFolder(Path(settings["spool"]))
    bus.serve_left_spools(spools)
    # First: whoever publishes before it has met the recorder does not wait for it.
    bus.discover()
    publisher = bus.publisher(bus.keys.rig_signal("bench", "faults.1"), spools=spools, durable=True)
    sys.stdout.write(f"{publisher.epoch}\n")
    sys.stdout.flush()
    for number in range(settings["count"]):
        publisher.put(rig_pb2.SignalBlock(first_sample=number, sample_rate=1000.0, run="x" * 5000))
        time.sleep(settings["pause"])
    if settings["closes"]:
        publisher.close()
    sys.stdin.read()
