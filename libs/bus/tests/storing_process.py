"""A receiver as a process of its own, so that a test can kill or freeze it: every number on its own line of a file."""

import os
import sys
import threading
from pathlib import Path

import duralab_bus
from duralab_proto.v1 import rig_pb2

endpoint, path = sys.argv[1:]
config = duralab_bus.BusConfig(connect=(endpoint,))
with duralab_bus.open_bus(config, service="recorder") as bus, Path(path).open("ab", 0) as file:
    lock, positions = threading.Lock(), []

    def store(item):
        os.write(file.fileno(), b"%d %d\n" % (item.epoch, item.seq))
        with lock:
            positions.append(item.position)

    subscription = bus.subscribe(bus.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, store, repair=True)
    bus.declare_live("recorder", "main")
    while True:
        threading.Event().wait(0.05)
        with lock:
            stored, positions = positions, []
        subscription.mark(stored)
