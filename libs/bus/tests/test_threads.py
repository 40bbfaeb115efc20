"""A script may end at any moment: no thread of its bus is left when its interpreter ends.

One that came back from Zenoh then would abort the process after its work was done.
"""

import subprocess
import sys

import pytest

SCRIPT = """
import atexit
import threading

# Registered first, so it runs after the end of the bus.
atexit.register(lambda: print([each.name for each in threading.enumerate()]))

from duralab_bus import BusConfig, open_bus
from duralab_proto.v1 import rig_pb2

bus = open_bus(BusConfig(), service="rig_sim")
bus.serve(bus.keys.rig_reset("axle"), rig_pb2.ResetRequest, lambda call: rig_pb2.RigState())
bus.subscribe(bus.keys.rig_state("axle"), rig_pb2.RigState, lambda item: None, repair=True)
bus.declare_live("rig_sim", "axle")
asking = open_bus(BusConfig(connect=bus.listening), service="duralab")
asking.wait_for_live({("rig_sim", "axle")}, 30.0)
"""


@pytest.mark.parametrize("end", ["", "bus.close()", "asking.close(); bus.close()"], ids=["open", "half", "closed"])
def test_no_thread_of_a_bus_outlives_the_script(end):
    command = [sys.executable, "-c", SCRIPT + end]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "['MainThread']\n", "")
