"""What a service imports before it answers: nothing that takes half a second and is needed later only."""

import subprocess
import sys

import pytest

SLOW = ("scipy.stats", "scipy.signal", "scipy.interpolate", "scipy.optimize", "xarray", "matplotlib", "pandas")


@pytest.mark.parametrize("service", ["file_rig", "identifier", "iterator", "recorder", "rig_sim", "sequencer"])
def test_a_service_imports_nothing_slow_at_its_start(service):
    program = f"import sys, {service}.service; print(*(name for name in {SLOW!r} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
