"""SDynPy's first drive, run by the Python of its environment: `inverse_peer.py RESULT.npz`."""

import os
import sys
import time
from contextlib import redirect_stdout

import numpy as np
from inverse_problem import RATE, rig_and_target

REPETITIONS = 3


def sdynpy_drives() -> dict[str, np.ndarray]:
    """Return for each of its two methods the wall time and the drive."""
    # It opens a GUI's application where it is imported.
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    import sdynpy

    frequency, frf, target = rig_and_target()
    drives = sdynpy.coordinate_array(np.arange(1, target.shape[0] + 1), 1)
    responses = sdynpy.coordinate_array(np.arange(101, target.shape[0] + 101), 1)
    kinds = sdynpy.data.FunctionTypes
    known = sdynpy.data_array(
        kinds.FREQUENCY_RESPONSE_FUNCTION,
        frequency,
        np.moveaxis(frf, 0, -1),
        sdynpy.coordinate.outer_product(responses, drives),
    )
    wanted = sdynpy.data_array(kinds.TIME_RESPONSE, np.arange(target.shape[1]) / RATE, target, responses[:, np.newaxis])
    found: dict[str, np.ndarray] = {}
    for method in ("single_frame", "cola"):
        times = []
        for _ in range(REPETITIONS):
            start = time.perf_counter()
            drive = wanted.mimo_inverse(known, time_method=method)
            times.append(time.perf_counter() - start)
        found[f"{method}_seconds"] = np.array(min(times))
        found[f"{method}_drive"] = drive.ordinate
    return found


if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with redirect_stdout(sys.stderr):
        drives = sdynpy_drives()
    np.savez(sys.argv[1], **drives)
