"""A client as a process of its own, so that a test can kill it: asks the runs given, each when it is told to."""

import sys

import labbus
from duralab_proto.v1 import rig_pb2

mode, endpoint, *runs = sys.argv[1:]
with labbus.open_bus(labbus.BusConfig(mode=mode, connect=(endpoint,)), service="asking") as bus:
    for number, run in enumerate(runs):
        if number:
            sys.stdout.write("answered\n")
            sys.stdout.flush()
            sys.stdin.readline()
            bus.wait_for_live({("rig_sim", "bench")}, 120.0)
        bus.query(bus.keys.rig_play("bench"), rig_pb2.PlayRequest(run=run), rig_pb2.PlayResult)
