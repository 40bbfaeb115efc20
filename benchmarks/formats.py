"""Measure how long a 60 min × 32 channel RPC III file takes to read, beside what numpy needs for its bytes.

numpy's share is the same float64 numbers in the order of the file: `np.fromfile` of all bytes, then `astype`.

`python benchmarks/formats.py [--minutes M] [--channels N] [--rate HZ] [--folder DIR]`
"""

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from machine import machine

from duralab import Channel, Signals
from duralab.formats.rpc3_layout import DataType
from duralab.formats.rpc3_reading import open_rpc3, read_rpc3
from duralab.formats.rpc3_writing import Rpc3Settings, write_rpc3

REPETITIONS = 3
BLOCK_SAMPLES = 1 << 16


def write(path: Path, *, data_type: DataType, minutes: float, channels: int, rate: float) -> float:
    """Write noise of that length; return how long the writer took in seconds."""
    samples = round(minutes * 60 * rate)
    noise = np.random.default_rng(0).normal(size=(channels, BLOCK_SAMPLES))
    repeated = np.take(noise, np.arange(samples) % BLOCK_SAMPLES, axis=1)
    signals = Signals(tuple(Channel(f"channel_{row}", "N") for row in range(channels)), rate, repeated)
    return _seconds(lambda: write_rpc3(signals, path, Rpc3Settings(data_type=data_type)), repetitions=1)


def numpy_of_its_bytes(path: Path) -> np.ndarray:
    """Return all of a file's numbers as float64, in the order of the file."""
    file = open_rpc3(path)
    return np.fromfile(path, dtype=file.layout.dtype, offset=file.header.size).astype(np.float64)


def _seconds(action: Callable[[], object], *, repetitions: int = REPETITIONS) -> float:
    """Return the shortest of some times; the first also brings the file into the system's cache."""
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--channels", type=int, default=32)
    parser.add_argument("--rate", type=float, default=512.0)
    parser.add_argument("--folder", type=Path, default=None)
    asked = parser.parse_args()
    sys.stdout.write(f"{machine()}\n")
    sys.stdout.write(f"{asked.minutes:g} min × {asked.channels} channels at {asked.rate:g} Hz\n")
    with tempfile.TemporaryDirectory(dir=asked.folder) as folder:
        for data_type in DataType:
            path = Path(folder) / "long.rsp"
            written = write(path, data_type=data_type, minutes=asked.minutes, channels=asked.channels, rate=asked.rate)
            peer, own = _seconds(lambda p=path: numpy_of_its_bytes(p)), _seconds(lambda p=path: read_rpc3(p))
            sys.stdout.write(
                f"{data_type.value:<15} {path.stat().st_size / 2**20:6.0f} MiB   write {written:6.2f} s   "
                f"read {own:6.2f} s   numpy {peer:6.2f} s   ratio {own / peer:5.2f}\n"
            )
            path.unlink()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    sys.stdout.write(f"peak memory {peak:.0f} MiB\n")


if __name__ == "__main__":
    main()
