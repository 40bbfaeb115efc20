"""Measure the read time of a 60 min × 32 channel RPC III file, and numpy's time for its bytes.

numpy's share is the same float64 numbers in the order of the file: `np.fromfile` of all bytes, then `astype`.

`python benchmarks/formats.py [--minutes M] [--channels N] [--rate HZ] [--folder DIR]`
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from machine import machine

from duralab import Channel, Signals
from duralab.formats.rpc3 import read_rpc3, write_rpc3
from duralab_drive_files import DataType, Rpc3Settings, open_rpc3

REPETITIONS = 5
BLOCK_SAMPLES = 1 << 16


def write(path: Path, *, data_type: DataType, minutes: float, channels: int, rate: float) -> float:
    """Write noise of that length; return the writer's time in seconds."""
    samples = round(minutes * 60 * rate)
    noise = np.random.default_rng(0).normal(size=(channels, BLOCK_SAMPLES))
    repeated = np.take(noise, np.arange(samples) % BLOCK_SAMPLES, axis=1)
    signals = Signals(tuple(Channel(f"channel_{row}", "N") for row in range(channels)), rate, repeated)
    return _seconds(lambda: write_rpc3(signals, path, Rpc3Settings(data_type=data_type)))


def numpy_of_its_bytes(path: Path) -> np.ndarray:
    """Return all of a file's numbers as float64, in the order of the file."""
    file = open_rpc3(path)
    return np.fromfile(path, dtype=file.layout.dtype, offset=file.header.size).astype(np.float64)


def _seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _shortest_in_turns(*actions: Callable[[], object]) -> list[float]:
    """Return the shortest of some times of each, in turns: a neighbour's minute is the same for all.

    The first also brings the file into the system's cache.
    """
    rounds = [[_seconds(action) for action in actions] for _ in range(REPETITIONS)]
    return [min(times) for times in zip(*rounds, strict=True)]


def measure_formats(
    folder: Path | None = None, *, minutes: float = 60.0, channels: int = 32, rate: float = 512.0
) -> dict[str, object]:
    """Write and read a long file of each data type.

    Parameters
    ----------
    folder : Path, optional
        On whose disk; that of temporary files where not given.
    minutes, channels, rate : float, int, float
        Length, width and sample rate in Hz of the file.

    Returns
    -------
    dict
        By data type: MiB, times in s, and reading over numpy's time; the peak memory of this process in MiB.
    """
    figures: dict[str, object] = {"file": f"{minutes:g} min of {channels} channels at {rate:g} Hz"}
    with tempfile.TemporaryDirectory(dir=folder) as name:
        for data_type in DataType:
            path = Path(name) / "long.rsp"
            written = write(path, data_type=data_type, minutes=minutes, channels=channels, rate=rate)
            peer, own = _shortest_in_turns(lambda p=path: numpy_of_its_bytes(p), lambda p=path: read_rpc3(p))
            figures[data_type.value] = {
                "mebibytes": path.stat().st_size / 2**20,
                "write_seconds": written,
                "read_seconds": own,
                "numpy_seconds": peer,
                "read_over_numpy": own / peer,
            }
            path.unlink()
    figures["peak_mebibytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    return figures


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--channels", type=int, default=32)
    parser.add_argument("--rate", type=float, default=512.0)
    parser.add_argument("--folder", type=Path, default=None)
    asked = parser.parse_args()
    figures = measure_formats(asked.folder, minutes=asked.minutes, channels=asked.channels, rate=asked.rate)
    sys.stdout.write(json.dumps({"machine": machine(), **figures}, indent=2) + "\n")


if __name__ == "__main__":
    main()
