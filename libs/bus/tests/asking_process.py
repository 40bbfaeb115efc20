"""A client as a process of its own, so that a test can kill it: asks the runs given, each when it is told to."""

import sys
import time

import duralab_bus
from duralab_proto.v1 import query_pb2, rig_pb2

# After a freeze: not met again yet, not on all keys, or the link broke under the query.
LINKS_ARE_MADE_ANEW = (
    query_pb2.FAULT_CODE_UNAVAILABLE,
    query_pb2.FAULT_CODE_UNIMPLEMENTED,
    query_pb2.FAULT_CODE_DATA_LOSS,
)

mode, endpoint, *runs = sys.argv[1:]
with duralab_bus.open_bus(duralab_bus.BusConfig(mode=mode, connect=(endpoint,)), service="asking") as bus:
    for number, run in enumerate(runs):
        if number:
            sys.stdout.write("answered\n")
            sys.stdout.flush()
            sys.stdin.readline()
            bus.wait_for_live({("rig_sim", "bench")}, 120.0)
        while True:
            try:
                bus.query(bus.keys.rig_play("bench"), rig_pb2.PlayRequest(run=run), rig_pb2.PlayResult)
                break
            except duralab_bus.FaultError as fault:
                if not number or fault.code not in LINKS_ARE_MADE_ANEW:
                    raise
                time.sleep(0.1)
