"""A peer at the same work, run by the Python of its own environment: `identification_peer.py NAME RESULT.npz`."""

import os
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout

import numpy as np
from identification_records import BLOCK, OVERLAP, RATE, noise_record, resonant_record, scaled_record

SECONDS, CHANNELS, REPETITIONS = 600.0, 8, 9
COMPARED_SECONDS, LOCAL_SECONDS = 120.0, 32.768
HALF_WIDTH = 30


def sdynpy_results() -> dict[str, np.ndarray]:
    """Return SDynPy's wall time for H1 and its H1, H2, Hv, local polynomial and local rational FRFs."""
    # It opens a GUI's application where it is imported.
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    from sdynpy.signal_processing.sdynpy_frf import timedata2frf

    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(BLOCK) / BLOCK)

    def spectral(drive: np.ndarray, response: np.ndarray, method: str) -> np.ndarray:
        return timedata2frf(drive, response, 1.0 / RATE, BLOCK, OVERLAP, method=method, window=window)[1]

    drive, response = noise_record(seconds=SECONDS, channels=CHANNELS)
    results = {"seconds": np.array(_best(lambda: spectral(drive, response, "H1")))}
    compared = resonant_record(seconds=COMPARED_SECONDS, noise=1e-3)
    for method in ("H1", "H2"):
        results[method.lower()] = spectral(*compared, method)
    results["hv"] = spectral(*scaled_record(), "Hv")
    drive, response = resonant_record(seconds=LOCAL_SECONDS, noise=0.0)
    lines = np.arange(BLOCK // 2 + 1) * (RATE / BLOCK)
    for name, orders in (("local_polynomial", [2, 2, 0]), ("local_rational", [2, 2, 2])):
        results[name] = timedata2frf(
            drive,
            response,
            1.0 / RATE,
            method="LRM",
            f_out=lines[(lines >= 10.0) & (lines <= 60.0)],
            bandwidth=2.0 * HALF_WIDTH / LOCAL_SECONDS,
            modelset=[np.array(orders)],
            export_ratio=1e-6,
            max_parallel=1,
            print_time=False,
        )[1]
    return results


def pyfrf_results() -> dict[str, np.ndarray]:
    """Return pyFRF's wall time for H1, and its H1 and H2."""
    from pyFRF import FRF

    def spectral(drive: np.ndarray, response: np.ndarray) -> object:
        return FRF(
            int(RATE),
            exc=drive[None],
            resp=response[None],
            resp_type="d",
            window="hann",
            nperseg=BLOCK,
            noverlap=round(BLOCK * OVERLAP),
            fft_len=BLOCK,
        )

    drive, response = noise_record(seconds=SECONDS, channels=CHANNELS)
    results = {"seconds": np.array(_best(lambda: spectral(drive, response).get_H1()))}
    compared = spectral(*resonant_record(seconds=COMPARED_SECONDS, noise=1e-3))
    results["h1"], results["h2"] = (frf.transpose(2, 0, 1) for frf in (compared.get_H1(), compared.get_H2()))
    return results


def rattlesnake_results() -> dict[str, np.ndarray]:
    """Return Rattlesnake's wall time for H1, and its H1."""
    from rattlesnake_peer import rattlesnake_h1

    drive, response = noise_record(seconds=SECONDS, channels=CHANNELS)
    seconds = np.array(_best(lambda: rattlesnake_h1(drive, response)))
    return {"seconds": seconds, "h1": rattlesnake_h1(*resonant_record(seconds=COMPARED_SECONDS, noise=1e-3))}


def _best(work: Callable[[], object]) -> float:
    times = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with redirect_stdout(sys.stderr):
        works = {"sdynpy": sdynpy_results, "pyfrf": pyfrf_results, "rattlesnake": rattlesnake_results}
        found = works[sys.argv[1]]()
    np.savez(sys.argv[2], **found)
