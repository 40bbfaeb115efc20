"""A client as a process of its own: asks a rig ten thousand times and says how its memory grew, in bytes a query.

Arguments: an endpoint of the lab, and the longest time of each query in seconds. As many queries are asked before it
counts, so that what grows once is not taken for what each query leaves.
"""

import ctypes
import gc
import sys
import time
from pathlib import Path

import duralab_bus
from duralab_proto.v1 import rig_pb2

QUERIES = 10_000


def resident_bytes():
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


endpoint, longest_seconds = sys.argv[1], float(sys.argv[2])
with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(endpoint,)), service="asking") as bus:

    def ask(times):
        for _ in range(times):
            bus.query(
                bus.keys.rig_stop("bench"), rig_pb2.StopRequest(), rig_pb2.RigState, longest_seconds=longest_seconds
            )
        # Until the time of the last one is over, where it is a short one.
        time.sleep(min(longest_seconds, 2.0))

    bus.wait_for_live({("rig_sim", "bench")}, 60.0)
    ask(QUERIES)
    before = resident_bytes()
    ask(QUERIES)
    sys.stdout.write(f"{(resident_bytes() - before) / QUERIES}\n")
