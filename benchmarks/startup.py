"""Measure the waiting times at the start: imports, help, a lab, and a campaign from the shell.

`python benchmarks/startup.py [--rounds N]`
"""

import argparse
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from machine import machine

from duralab.lab import Lab
from duralab.profile import Profile
from duralab_bus import BusConfig, SpanKind, open_bus

COMMANDS = {
    "python": ["-c", "pass"],
    "import duralab": ["-c", "import duralab"],
    "duralab --help": ["-m", "duralab", "--help"],
    "duralab run --help": ["-m", "duralab", "run", "--help"],
    "duralab.connect": ["-c", "import duralab; duralab.connect"],
}
DEAREST = 5
ROUNDS = 7
RIG = "front_axle"
CAMPAIGN = "front_axle_demo"
LAB_ROUNDS = 3
CAMPAIGN_ROUNDS = 7
ENDPOINT = "tcp/127.0.0.1:7489"
POLL_SECONDS = 0.005


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
        # One run before, so that bytecode exists.
        seconds(arguments)
        taken = [seconds(arguments) for _ in range(rounds)]
        figures[name] = {
            "wall": min(wall for wall, _ in taken),
            "processor": min(processor for _, processor in taken),
            "dearest": dearest_imports(arguments),
        }
    return figures


def measure_lab() -> dict[str, float]:
    """Return the time until a rig of `duralab up` answers, and the time of a campaign from the shell.

    Cold is without compiled code on disk, warm the best of some rounds with it. A campaign is reported over simulation
    and mathematics alone, both from its own trace: the middle one of some, because the ratio of the fastest is chance.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = os.environ | {"DURALAB_CODE_CACHE": str(folder / "code")}
        cold = _first_answer(folder / "cold", environment)
        warm = min(_first_answer(folder / f"warm{turn}", environment) for turn in range(LAB_ROUNDS))
        campaigns = [_campaign(folder / f"campaign{turn}", environment) for turn in range(CAMPAIGN_ROUNDS)]
    return {
        "first_answer_cold": cold,
        "first_answer_warm": warm,
        "campaign": min(seconds for seconds, _ in campaigns),
        "campaign_over_simulation_and_mathematics": median(seconds / alone for seconds, alone in campaigns),
    }


def _first_answer(folder: Path, environment: dict[str, str]) -> float:
    """Return the seconds from the start of `duralab up` until a rig of the lab describes itself."""
    command = [sys.executable, "-m", "duralab", "up", "--listen", ENDPOINT, "--recordings", str(folder)]
    start = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while not _is_open():
            time.sleep(POLL_SECONDS)
        with open_bus(BusConfig(connect=(ENDPOINT,)), service="bench") as bus:
            while ("rig_sim", RIG) not in bus.live():
                time.sleep(POLL_SECONDS)
            Lab(bus, out=folder).describe(RIG)
            return time.perf_counter() - start
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def _is_open() -> bool:
    host, port = ENDPOINT.removeprefix("tcp/").split(":")
    try:
        socket.create_connection((host, int(port)), timeout=1.0).close()
    except OSError:
        return False
    return True


def _campaign(folder: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Return the time of a campaign from the shell, and its shares of simulation and mathematics, in s.

    From the start of the process to its end, without the reading and writing of the profile, which only this option
    does.
    """
    command = [sys.executable, "-m", "duralab", "run", CAMPAIGN, "--out", str(folder), "--profile"]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    finished, file = time.time(), folder / "profile.json"
    profile = Profile(json.loads(file.read_text())["traceEvents"])
    began, ended = profile.period
    spent = profile.shares(began, ended)
    return (ended - began) + (finished - file.stat().st_mtime), spent[SpanKind.PLAYBACK] + spent[SpanKind.MATHEMATICS]


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    figures = measure_startup(rounds=parser.parse_args().rounds)
    sys.stdout.write(json.dumps({"machine": machine(), **figures, "lab": measure_lab()}, indent=2) + "\n")


if __name__ == "__main__":
    main()
