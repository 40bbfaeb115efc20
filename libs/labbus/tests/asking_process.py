"""A client as a process of its own, so that a test can kill it: asks one run of the rig at the endpoint given."""

import sys

import labbus
from duralab_proto.v1 import rig_pb2

endpoint, run = sys.argv[1:]
with labbus.open_bus(labbus.BusConfig(connect=(endpoint,)), service="asking") as bus:
    bus.query(bus.keys.rig_play("bench"), rig_pb2.PlayRequest(run=run), rig_pb2.PlayResult)
