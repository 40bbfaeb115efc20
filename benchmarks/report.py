"""Measure the write time and the size of the report of a 10-iteration campaign.

The shipped demo is run with ten playbacks, or a recording is taken as it is. Each time is that of a whole process, with
its imports, as `duralab report` takes it; the first is left out where files are read for the first time.

`python benchmarks/report.py [--recording FILE] [--iterations N]`
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from machine import machine

import duralab

REPETITIONS = 3
ITERATIONS = 10
WRITE = "import sys; from duralab.report import write_report; write_report(*sys.argv[1:])"


def record(folder: Path, *, iterations: int) -> Path:
    """Run the demo with that many playbacks; return its recording."""
    demo = duralab.load_campaign("front_axle_demo")
    campaign = demo.model_copy(update={"stop": demo.stop.model_copy(update={"iterations": iterations})})
    with duralab.start(folder / "lab") as lab:
        return lab.run(campaign, out=folder / "demo").recording_path


def write(recording: Path, report: Path) -> tuple[float, float]:
    """Write the report in a separate process; return its wall time and its processor time, in s."""
    before, start = os.times(), time.perf_counter()
    subprocess.run([sys.executable, "-c", WRITE, str(recording), str(report)], check=True)
    wall, after = time.perf_counter() - start, os.times()
    return wall, after.children_user + after.children_system - before.children_user - before.children_system


def measure_report(recording: Path | None = None, *, iterations: int = ITERATIONS) -> dict[str, float]:
    """Write the report of a recording, by default of the demo.

    Returns
    -------
    dict
        Playbacks in it, wall and processor time in s of the fastest of three processes, megabytes.
    """
    with tempfile.TemporaryDirectory() as folder:
        recorded = recording or record(Path(folder), iterations=iterations)
        report = Path(folder) / "report.html"
        playbacks = len(duralab.open_recording(recorded).iterations)
        wall, processor = min(write(recorded, report) for _ in range(REPETITIONS))
        size = report.stat().st_size / 1e6
    return {"playbacks": playbacks, "seconds": wall, "processor_seconds": processor, "megabytes": size}


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recording", type=Path, default=None)
    parser.add_argument("--iterations", type=int, default=ITERATIONS)
    asked = parser.parse_args()
    figures = measure_report(asked.recording, iterations=asked.iterations)
    sys.stdout.write(json.dumps({"machine": machine(), **figures}, indent=2) + "\n")


if __name__ == "__main__":
    main()
