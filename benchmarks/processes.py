"""Cost of a rig in a separate process: time until it is ready, memory while it plays. `bench.py` runs it."""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

PLAYED_SECONDS = 120.0
_MEBIBYTE = 2**20


def startup_seconds(path: Path) -> tuple[float, float]:
    """Return the wall time of a process that imports, loads and proves a rig: cold, then warm.

    Cold is without bytecode and without compiled code, as the first time after an installation; the disk's cache cannot
    be emptied.
    """
    with tempfile.TemporaryDirectory() as empty:
        bare = {"PYTHONPYCACHEPREFIX": empty, "DURALAB_CODE_CACHE": str(Path(empty) / "code")}
        cold = _timed(path, os.environ | bare)
    return cold, _timed(path, dict(os.environ))


@dataclass(frozen=True)
class Memory:
    """Memory in MiB of a process that loads a rig and plays 120 s: its peak, and its growth beyond the record."""

    peak: float
    growth: float


def memory(path: Path, *, share: float) -> Memory:
    """Return what a process takes at most over a playback of 120 s, and what of it is neither drive nor response."""
    command = [sys.executable, __file__, str(path), str(share)]
    return Memory(**json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout))


def _timed(path: Path, environment: dict[str, str]) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, __file__, str(path)], env=environment, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def resident_bytes(field: str) -> int:
    """Return a size of this process in bytes, by its name in /proc: VmRSS now, VmHWM at most."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/self/status has no {field}; measure memory on Linux.")


def _measure_memory(path: Path, share: float) -> Memory:
    from drives import noise_drive
    from speed import play

    from rig_sim import load_any_rig

    rig = load_any_rig(path)
    play(rig, noise_drive(rig, seconds=5.0, share=share))
    drive = noise_drive(rig, seconds=PLAYED_SECONDS, share=share)
    response_bytes = len(rig.specimen.responses) * drive.shape[1] * drive.itemsize
    Path("/proc/self/clear_refs").write_text("5")  # the highest so far is forgotten
    before = resident_bytes("VmRSS")
    play(rig, drive)
    peak = resident_bytes("VmHWM")
    return Memory(peak=peak / _MEBIBYTE, growth=(peak - before - response_bytes) / _MEBIBYTE)


def main() -> None:
    """Load the rig of the first argument; with the share of a drive as the second, also play and write the memory."""
    path = Path(sys.argv[1])
    if len(sys.argv) > 2:
        sys.stdout.write(json.dumps(asdict(_measure_memory(path, float(sys.argv[2])))))
        return
    from rig_sim import load_any_rig

    load_any_rig(path)


if __name__ == "__main__":
    main()
