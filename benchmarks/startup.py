"""Measure how long `import duralab`, `duralab --help` and the help of a command take, and what the imports cost.

`python benchmarks/startup.py [--rounds N] [--out FILE]`
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from machine import machine

BUDGETS = {"import duralab": 0.5, "duralab --help": 0.7}
"""Seconds of wall time that are allowed on an idle machine."""

COMMANDS = {
    "python": ["-c", "pass"],
    "import duralab": ["-c", "import duralab"],
    "duralab --help": ["-m", "duralab", "--help"],
    "duralab run --help": ["-m", "duralab", "run", "--help"],
    "duralab.connect": ["-c", "import duralab; duralab.connect"],
}
DEAREST = 5


def seconds(arguments: list[str]) -> tuple[float, float]:
    """Return the wall time and the processor time of one run of Python, in s."""
    before, start = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - start, os.times()
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, processor


def dearest_imports(arguments: list[str]) -> dict[str, float]:
    """Return the modules whose own code takes longest to import, in s."""
    told = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments], check=True, capture_output=True, text=True
    ).stderr
    own = {
        name.strip(): int(micro) / 1e6
        for micro, name in re.findall(r"(?m)^import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)$", told)
    }
    return dict(sorted(own.items(), key=lambda item: -item[1])[:DEAREST])


def measure(rounds: int) -> dict[str, dict[str, object]]:
    """Return the figures of every command; the fastest of all rounds counts: others can only make it slower."""
    figures = {}
    for name, arguments in COMMANDS.items():
        # Once before, so that bytecode is there.
        seconds(arguments)
        taken = [seconds(arguments) for _ in range(rounds)]
        figures[name] = {
            "wall": min(wall for wall, _ in taken),
            "processor": min(processor for _, processor in taken),
            "allowed": BUDGETS.get(name),
            "dearest": dearest_imports(arguments),
        }
    return figures


def main() -> None:
    """Measure, write the figures and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    figures = measure(arguments.rounds)
    if arguments.out is not None:
        arguments.out.write_text(json.dumps({"machine": machine(), "startup": figures}, indent=2) + "\n")
    sys.stdout.write(f"{'':<20}{'wall s':>8}{'proc. s':>9}{'allowed':>9}\n")
    for name, figure in figures.items():
        allowed = "" if figure["allowed"] is None else f"{figure['allowed']:g}"
        sys.stdout.write(f"{name:<20}{figure['wall']:>8.3f}{figure['processor']:>9.3f}{allowed:>9}\n")


if __name__ == "__main__":
    main()
