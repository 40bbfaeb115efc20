"""Faults of a controller that exchanges files, at `file_rig` as a process; it plays on a rig of the same lab."""

from __future__ import annotations

import itertools
import re
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import yaml
from scipy import signal

from duralab.errors import LabError, StoppedError
from duralab.lab import Lab
from duralab.testing import ControllerFault, FileController, LinearRig, file_gateway, lab
from duralab_drive_files import read_controller_map

from .file_faults import LARGEST_ERROR, REASONS, FileRounds

RIG = "linear_by_files"
_GAIN = 1.005
_SECONDS = 12.0
_WAIT_SECONDS = 60.0
_LEAD = 0.5
_MAP = {
    "rig": RIG,
    "sample_rate": 1000.0,
    "controller_rate": 1024.0,
    "lead": _LEAD,
    "drives": {
        f"stroke_{number}": {
            "kind": "displacement",
            "unit": "mm",
            "channel": f"Stroke {number}",
            "sign": sign,
            "minimum": -99.0,
            "maximum": 99.0,
            "recorded_command": f"Stroke {number} Cmd",
        }
        for number, sign in ((1, 1), (2, -1))
    },
    "responses": {
        f"force_{number}": {
            "kind": "force",
            "unit": "kN",
            "minimum": -1000.0,
            "maximum": 1000.0,
            "channel": f"Load {number}",
        }
        for number in (1, 2)
    },
}


def perform_at_gateway(
    folder: Path, *, rounds: int, seed: int, tell: Callable[[FileRounds], None] = lambda _done: None
) -> list[FileRounds]:
    """Play so many rounds of each fault, and as many without one, through `file_rig`."""
    rig, results = LinearRig(), []
    folder.mkdir(parents=True)
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(_MAP), encoding="utf-8")
    with (
        lab(rig, out=folder / "lab") as running,
        file_gateway(path, running.endpoints[0], folder=folder / "gateway"),
        _controller(running, rig, path) as controller,
    ):
        # First, so that each fault has a run before it.
        for fault in (None, *ControllerFault):
            done = FileRounds(f"{fault or 'no fault'}, at file_rig")
            for number in range(rounds):
                random = np.random.default_rng([seed, len(results), number])
                began = time.perf_counter()
                finding = _finding(running, rig, controller, fault, random)
                done.add(finding, number, time.perf_counter() - began)
            results.append(done)
            tell(done)
    return results


@contextmanager
def _controller(running: Lab, rig: LinearRig, path: Path) -> Iterator[FileController]:
    seeds = itertools.count()

    def play(drive: np.ndarray) -> np.ndarray:
        return running.play(rig.name, drive, seed=next(seeds)).response.samples

    controller = FileController(read_controller_map(path), play, gain=_GAIN, response_rate=2048.0, write_seconds=1.0)
    thread = threading.Thread(target=controller.run)
    thread.start()
    try:
        yield controller
    finally:
        controller.end()
        thread.join()


def _finding(
    running: Lab, rig: LinearRig, controller: FileController, fault: ControllerFault | None, random: np.random.Generator
) -> str:
    drive = _drive(random)
    run = f"run_{len(controller.played_runs)}"
    controller.faults = frozenset() if fault is None else frozenset([fault])
    inbox = controller.folder / "inbox"
    wrong = ""
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(running.play, RIG, drive, run=run, timeout_seconds=_WAIT_SECONDS)
        try:
            if fault in (None, ControllerFault.HALF_WRITTEN):
                wrong = _compared(rig, drive, asked.result().response.samples)
            else:
                reason = _until(lambda: _text(inbox / f"{run}.rsp.refused.txt") or (asked.done() and "not found"))
                if not re.search(REASONS[fault], reason):
                    wrong = f"refused for another reason: {reason}"
                (inbox / f"{run}.refuse.txt").write_text("the response file is not of this run")
                asked.result()
                wrong = "not found"
        except StoppedError as ended:
            wrong = wrong or ("" if "not of this run" in str(ended) and fault is not None else str(ended))
        except LabError as error:
            wrong = f"{error}"
    if controller.played_runs.count(run) != 1:
        wrong = f"{run} was played {controller.played_runs.count(run)} times"
    return wrong or ("" if running.state(RIG).resting else f"left the rig {running.state(RIG)}")


def _drive(random: np.random.Generator) -> np.ndarray:
    samples = round(1000.0 * _SECONDS)
    band = signal.butter(2, [1.0, random.uniform(15.0, 40.0)], "band", fs=1000.0, output="sos")
    drive = signal.sosfiltfilt(band, random.standard_normal((2, samples)), axis=1) * signal.windows.tukey(samples, 0.2)
    return drive / np.abs(drive).max(axis=1, keepdims=True) * random.uniform(0.005, 0.08, (2, 1))


def _compared(rig: LinearRig, drive: np.ndarray, response: np.ndarray) -> str:
    lead = round(1000.0 * _LEAD)
    truth = rig.respond(_GAIN * np.pad(drive, ((0, 0), (lead, lead))))[:, lead:-lead]
    error = float(np.max(np.std(response - truth, axis=1) / np.std(truth, axis=1)))
    return "" if error < LARGEST_ERROR else f"accepted with an error of {100.0 * error:.2f} %"


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _until(condition: Callable[[], str | bool]) -> str:
    end = time.monotonic() + _WAIT_SECONDS
    while not (found := condition()):
        if time.monotonic() > end:
            return "nothing, not even after a minute"
        time.sleep(0.05)
    return str(found)
