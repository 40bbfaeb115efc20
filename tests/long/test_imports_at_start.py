"""What a service imports before it answers: nothing that takes half a second and is needed later only."""

import os
import subprocess
import sys

import pytest

SERVICES = ("file_rig", "identifier", "iterator", "recorder", "rig_sim", "sequencer")
SLOW = ("scipy.stats", "scipy.signal", "scipy.interpolate", "scipy.optimize", "xarray", "matplotlib", "pandas", "rerun")


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_imports_nothing_slow_at_its_start(service):
    program = f"import sys, {service}.service; print(*(name for name in {SLOW!r} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_what_makes_a_road_target_imports_nothing_slow():
    """`duralab run` makes its target while the lab starts: the first iteration waits for it."""
    program = "import sys, duralab_roads, duralab.target.making; "
    program += f"print(*(name for name in {SLOW!r} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.skipif(sys.platform != "linux", reason="services are forked on Linux only")
def test_no_service_starts_threads_as_it_is_imported():
    """A fork would lose them."""
    imports = ", ".join(f"{service}.service" for service in SERVICES)
    program = f"import os, {imports}; print(len(os.listdir('/proc/self/task')))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.stdout.strip() == "1"


@pytest.mark.skipif(sys.platform != "linux", reason="services are forked on Linux only")
def test_forked_services_do_not_import_the_colours_of_a_terminal():
    """structlog imports rich where it is installed, in every process that writes a log."""
    program = "from duralab.processes import fork_server; fork_server.import_shared(); import sys, structlog; "
    program += "print('rich' in sys.modules, 'duralab_bus' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_the_base_of_scipy_is_imported_without_parts_of_numpy_that_nobody_uses():
    program = """
import sys, numpy
from duralab_bus import import_base_of_scipy
import_base_of_scipy()
import scipy.special, scipy.fft, scipy.ndimage
print(*(name for name in ("numpy.f2py", "numpy.testing", "numpy.ctypeslib") if name in sys.modules))
import numpy.testing
print(numpy.f2py.__name__, numpy.testing.__name__, numpy.ctypeslib.__name__)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["", "numpy.f2py numpy.testing numpy.ctypeslib"]
