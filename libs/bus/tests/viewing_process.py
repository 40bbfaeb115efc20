"""A viewer as a process of its own, so that a test can freeze it: takes every signal block and does nothing with it."""

import sys
import threading

import duralab_bus
from duralab_proto.v1 import rig_pb2

with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(sys.argv[1],)), service="viewer") as bus:
    subscription = bus.subscribe(bus.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, lambda _: None)
    bus.discover()
    bus.declare_live("viewer", "main")
    threading.Event().wait()
