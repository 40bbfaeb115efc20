"""Faults of a controller that exchanges files: each is found in the response file, alone and with a second one."""

from __future__ import annotations

import itertools
import re
import time
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from scipy import signal

from duralab.testing import ControllerFault, FileController
from duralab_drive_files import ControllerMap, DataType, DriveFileError, Inbox, Order, Outbox, read_controller_map

CLEAN = "no fault"
RATE = 500.0
LARGEST_ERROR = 2.0e-3
"""Of an accepted response over what was played, relative RMS: 16 bits and two rates."""

_ANOTHER = r"not follow|response of run|way in and drive take|follows|is inverted|of the drive's size"
"""By chance another run may look swapped or inverted; the sentence is wrong then, the refusal is not."""
REASONS = {
    ControllerFault.LOST_LAST_FRAME: r"bytes|samples|frames",
    ControllerFault.SHORT_RECORDING: r"way in and drive take|before the drive does|broken off",
    ControllerFault.SPAN_OF_80_PERCENT: r"(79|80)\.\d % of the drive's size",
    ControllerFault.SWAPPED_CHANNELS: r"follows",
    ControllerFault.INVERTED_CHANNEL: r"is inverted",
    ControllerFault.PREVIOUS_RUN: _ANOTHER,
    ControllerFault.OTHER_RUN: _ANOTHER,
    ControllerFault.DRIFTING_CLOCK: r"lag changes by",
    ControllerFault.BROKEN_OFF: r"broken off",
    ControllerFault.MISSING_CHANNEL: r"lacks|holds no",
    ControllerFault.NOT_FINITE: r"finite",
    ControllerFault.DAMAGED_FILE: r".",
    ControllerFault.HALF_WRITTEN: r".",
    ControllerFault.FUTURE_STAMP: r"in the future",
    ControllerFault.OLD_FILE: r"older than its drive",
}
"""What the reason beside a refused file has to say of a fault that is alone."""


@dataclass
class FileRounds:
    """Rounds of one or two faults; `right`: refused for it, or accepted where nothing is wrong with the file."""

    fault: str
    is_pair: bool = False
    rounds: int = 0
    right: int = 0
    slowest_seconds: float = 0.0
    findings: list[str] = field(default_factory=list)

    def add(self, finding: str, number: int, seconds: float) -> None:
        self.rounds += 1
        self.right += not finding
        self.slowest_seconds = max(self.slowest_seconds, seconds)
        if finding:
            self.findings.append(f"{self.fault} {number}: {finding}")


def single_faults() -> list[tuple[ControllerFault, ...]]:
    return [(fault,) for fault in ControllerFault]


def pairs_of_faults() -> list[tuple[ControllerFault, ...]]:
    return list(itertools.combinations(ControllerFault, 2))


def perform(
    kinds: list[tuple[ControllerFault, ...]],
    folder: Path,
    *,
    rounds: int,
    seed: int,
    tell: Callable[[FileRounds], None] = lambda _done: None,
) -> list[FileRounds]:
    """Play so many rounds of each, every one with a map, a drive and a controller that the seed draws."""
    results = []
    for faults in kinds:
        done = FileRounds(" and ".join(faults) or CLEAN, is_pair=len(faults) > 1)
        for number in range(rounds):
            random = np.random.default_rng([seed, zlib.crc32(done.fault.encode()), number])
            began = time.perf_counter()
            finding = Played(folder / f"{len(results)}_{number}", random).finding(faults)
            done.add(finding, number, time.perf_counter() - began)
        results.append(done)
        tell(done)
    return results


class _Exchange:
    """Outbox and inbox of one folder; a file counts as whole at once."""

    def __init__(self, outbox: Outbox) -> None:
        self.put, self.end = outbox.put, outbox.end
        self._inbox = Inbox(outbox, stable_seconds=0.0)
        self.take = self._inbox.take

    @property
    def refusal(self) -> str:
        return self._inbox.refusal


class Played:
    """A rig with a random map behind a random controller; two runs, the second one with faults."""

    def __init__(self, folder: Path, random: np.random.Generator) -> None:
        self._random = random
        folder.mkdir(parents=True)
        path = folder / "map.yaml"
        path.write_text(yaml.safe_dump(random_map(random)), encoding="utf-8")
        self._map = read_controller_map(path)
        self._plant = 1.0e4 * random.standard_normal((len(self._map.responses), len(self._map.drives)))
        self._response = np.empty((0, 0))

    def finding(self, faults: tuple[ControllerFault, ...]) -> str:
        """Return what is wrong with how the faults were judged; empty where they were found."""
        random = self._random
        controller = FileController(
            self._map,
            self._play,
            delay=float(random.choice([37.4, random.uniform(0.0, 200.0)])),
            gain=float(1.0 + random.uniform(-0.005, 0.005)),
            response_rate=float(random.choice([400.0, 500.0, 512.0, 1024.0])),
            data_type=DataType(random.choice([each.value for each in DataType])),
            seed=int(random.integers(2**32)),
        )
        with closing(Outbox(self._map)) as outbox:
            exchange = _Exchange(outbox)
            first = random_drive(self._map, random)
            runs = ["second"]
            if {ControllerFault.PREVIOUS_RUN, ControllerFault.OTHER_RUN}.intersection(faults):
                runs.insert(0, "first")
                if wrong := self._taken(exchange, controller, exchange.put("first", first), first):
                    return f"the run before it: {wrong}"
            # A repeat has the drive of the run before: only its bytes tell its file.
            is_repeat = ControllerFault.OTHER_RUN not in faults and random.random() < 0.2
            drive = first if is_repeat else random_drive(self._map, random)
            controller.faults = frozenset(faults)
            order = exchange.put("second", drive)
            if not faults:
                return self._taken(exchange, controller, order, drive)
            controller.step()
            wrong = self._refused(exchange, order, drive, faults)
            if not wrong and ControllerFault.HALF_WRITTEN in faults:
                if faults == (ControllerFault.HALF_WRITTEN,):
                    wrong = self._taken(exchange, controller, order, drive)
                else:
                    controller.step()
                    wrong = self._refused(exchange, order, drive, faults)
            return wrong or ("" if controller.played_runs == runs else "a run was played twice")

    def _play(self, drive: np.ndarray) -> np.ndarray:
        scale = np.array([[each.maximum] for each in self._map.drives])
        self._response = self._plant @ signal.sosfilt(_LOWPASS, drive / scale, axis=1)
        self._response += 0.01 * self._random.standard_normal(self._response.shape)
        return self._response

    def _taken(self, exchange: _Exchange, controller: FileController, order: Order, drive: np.ndarray) -> str:
        controller.step()
        accepted = exchange.take(order, drive)
        if accepted is None:
            return f"refused: {exchange.refusal or 'no file'}"
        exchange.end(order, "answered", response_sha256=accepted.sha256)
        lead = round(self._map.lead_seconds * RATE)
        played = self._response[:, lead : lead + drive.shape[1]]
        error = float(np.max(np.std(accepted.response - played, axis=1) / np.std(played, axis=1)))
        return "" if error < LARGEST_ERROR else f"accepted with an error of {100.0 * error:.2f} %"

    def _refused(
        self, exchange: _Exchange, order: Order, drive: np.ndarray, faults: tuple[ControllerFault, ...]
    ) -> str:
        try:
            accepted = exchange.take(order, drive)
        except DriveFileError as error:
            return f"raised {error}"
        if accepted is not None:
            return "not found"
        reason = exchange.refusal
        is_named = any(re.search(REASONS[fault], reason) for fault in faults) if len(faults) == 1 else bool(reason)
        return "" if is_named else f"refused for another reason: {reason or 'none'}"


_LOWPASS = signal.butter(2, 60.0, fs=RATE, output="sos")


def random_map(random: np.random.Generator) -> dict[str, object]:
    """Return a map of two to four drives, with units, signs and offsets of the controller."""
    kinds = [("displacement", "mm", 100.0), ("force", "kN", 20.0), ("displacement", "cm", 2.0)]
    drives, responses = {}, {}
    for number in range(int(random.integers(2, 5))):
        kind, unit, limit = kinds[int(random.integers(3))]
        offset = float(random.choice([0.0, 1.0]))
        drives[f"drive_{number}"] = {
            "kind": kind,
            "unit": unit,
            "channel": f"Actuator {number}",
            "sign": int(random.choice([-1, 1])),
            "offset": offset,
            "minimum": offset - limit,
            "maximum": offset + limit,
            "recorded_command": f"Actuator {number} Cmd",
        }
    for number in range(int(random.integers(1, 4))):
        responses[f"force_{number}"] = {
            "kind": "force",
            "unit": "kN",
            "minimum": -1000.0,
            "maximum": 1000.0,
            "channel": f"Load {number}",
            "sign": int(random.choice([-1, 1])),
            "offset": float(random.choice([0.0, 0.5])),
        }
    return {
        "rig": "beam",
        "sample_rate": RATE,
        "controller_rate": float(random.choice([500.0, 512.0, 1024.0])),
        "numbers": str(random.choice([each.value for each in DataType])),
        "lead": float(random.choice([0.5, 1.0])),
        "drive_has_offset": bool(random.random() < 0.3),
        "drives": drives,
        "responses": responses,
    }


def random_drive(controller_map: ControllerMap, random: np.random.Generator) -> np.ndarray:
    """Return a drive of 10 to 15 s in a band below 40 Hz, 2 to 90 % of each limit; now and then one does not move."""
    count, samples = len(controller_map.drives), int(random.integers(10, 16) * RATE)
    band = signal.butter(2, [random.uniform(0.3, 2.0), random.uniform(10.0, 40.0)], "band", fs=RATE, output="sos")
    drive = signal.sosfiltfilt(band, random.standard_normal((count, samples)), axis=1)
    drive *= signal.windows.tukey(samples, 0.1)
    limits = np.array([[each.maximum] for each in controller_map.drives])
    drive *= limits * random.uniform(0.02, 0.9, (count, 1)) / np.abs(drive).max(axis=1, keepdims=True)
    if count > 2 and random.random() < 0.2:
        drive[int(random.integers(count))] = 0.0
    return drive
