"""Measure how long `import duralab`, `duralab --help` and the help of a command take, and what the imports cost.

`python benchmarks/startup.py [--rounds N]`
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time

from machine import machine

COMMANDS = {
    "python": ["-c", "pass"],
    "import duralab": ["-c", "import duralab"],
    "duralab --help": ["-m", "duralab", "--help"],
    "duralab run --help": ["-m", "duralab", "run", "--help"],
    "duralab.connect": ["-c", "import duralab; duralab.connect"],
}
DEAREST = 5
ROUNDS = 7


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


def measure_startup(*, rounds: int = ROUNDS) -> dict[str, dict[str, object]]:
    """Return the figures of every command; the fastest of all rounds counts: others can only make it slower."""
    figures = {}
    for name, arguments in COMMANDS.items():
        # Once before, so that bytecode is there.
        seconds(arguments)
        taken = [seconds(arguments) for _ in range(rounds)]
        figures[name] = {
            "wall": min(wall for wall, _ in taken),
            "processor": min(processor for _, processor in taken),
            "dearest": dearest_imports(arguments),
        }
    return figures


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    figures = measure_startup(rounds=parser.parse_args().rounds)
    sys.stdout.write(json.dumps({"machine": machine(), **figures}, indent=2) + "\n")


if __name__ == "__main__":
    main()
