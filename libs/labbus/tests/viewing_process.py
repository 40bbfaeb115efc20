"""A viewer as a process of its own, so that a test can freeze it: takes every signal block and does nothing with it."""

import sys
import threading

import labbus
from duralab_proto.v1 import rig_pb2

with labbus.open_bus(labbus.BusConfig(connect=(sys.argv[1],)), service="viewer") as bus:
    subscription = bus.subscribe(bus.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, lambda _: None)
    bus.discover()
    bus.declare_live("viewer", "main")
    threading.Event().wait()
