"""How much of its actuators a playback used: valves, load pressures, supplies and following errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from duralab_gateway.motion import Use
from rig_sim.hydraulics import HydraulicActuator

#: Share of the largest load pressure from which an actuator counts as saturated: little flow is left to move it.
FULL_LOAD_PRESSURE = 0.95
#: Samples for which the use is counted at once: with blocks of 100 it took 4 % of a playback.
SAMPLES_COUNTED_AT_ONCE = 800


class UseMeter:
    """Meter of the actuators' use during a playback, block by block."""

    def __init__(
        self, actuators: Sequence[HydraulicActuator], *, drives: Sequence[str], outputs: Sequence[str]
    ) -> None:
        self._drives = tuple(drives)
        # Rows of the player's inputs and outputs, one for each actuator, evaluated together.
        self._driven = _rows(drives.index(actuator.name) for actuator in actuators)
        self._achieved = _rows(outputs.index(actuator.achieved) for actuator in actuators)
        self._valve = _rows(outputs.index(f"{actuator.name}.valve_command") for actuator in actuators)
        self._load_pressure = _rows(outputs.index(f"{actuator.name}.load_pressure") for actuator in actuators)
        self._supply_pressure = _rows(outputs.index(f"{actuator.supply}.pressure") for actuator in actuators)
        self._largest_opening = np.array([[actuator.valve.largest_opening] for actuator in actuators])
        self._count = len(actuators)
        self._saturated = np.zeros(self._count)
        self._following = np.zeros(self._count)
        self._load = np.zeros(self._count)
        self._supply = np.full(self._count, np.inf)
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._samples_waiting = 0

    def following_error(self, commands: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Return command minus achieved value."""
        error = np.zeros(commands.shape)
        if self._count:
            error[self._driven] = commands[self._driven] - outputs[self._achieved]
        return error

    def count(self, following_error: np.ndarray, outputs: np.ndarray) -> None:
        """Add a block of the drive; its arrays must not change afterwards."""
        if not self._count:
            return
        # Before the block is added: it may be taken back.
        if self._samples_waiting >= SAMPLES_COUNTED_AT_ONCE:
            self._count_waiting()
        self._waiting.append((following_error, outputs))
        self._samples_waiting += outputs.shape[1]

    def take_back(self) -> None:
        """Forget the last block."""
        if self._count:
            self._samples_waiting -= self._waiting.pop()[1].shape[1]

    def _count_waiting(self) -> None:
        following = _joined([error[self._driven] for error, _ in self._waiting])
        valve, load, supply = (
            _joined([outputs[rows] for _, outputs in self._waiting])
            for rows in (self._valve, self._load_pressure, self._supply_pressure)
        )
        self._waiting.clear()
        self._samples_waiting = 0
        valve, load = np.abs(valve), np.abs(load)
        largest_load = load.max(axis=1)
        if (
            valve.max(axis=1, keepdims=True) >= self._largest_opening
        ).any() or largest_load.max() >= FULL_LOAD_PRESSURE:
            at_its_end = (valve >= self._largest_opening) | (load >= FULL_LOAD_PRESSURE)
            self._saturated += at_its_end.sum(axis=1)
        np.maximum(self._following, np.abs(following).max(axis=1), out=self._following)
        np.maximum(self._load, largest_load, out=self._load)
        np.minimum(self._supply, supply.min(axis=1), out=self._supply)

    def uses(self, peak_ratios: Sequence[float], *, samples: int) -> list[Use]:
        """Return the use of every drive channel."""
        if self._waiting:
            self._count_waiting()
        actuators = {drive: index for index, drive in enumerate(np.arange(len(self._drives))[self._driven].tolist())}
        uses = []
        for drive, name in enumerate(self._drives):
            peak, index = float(peak_ratios[drive]), actuators.get(drive)
            if index is None:
                uses.append(Use(drive=name, peak_command_ratio=peak, saturated_share=0.0, largest_following_error=0.0))
                continue
            supply = float(self._supply[index])
            uses.append(
                Use(
                    drive=name,
                    peak_command_ratio=peak,
                    saturated_share=float(self._saturated[index] / max(samples, 1)),
                    largest_following_error=float(self._following[index]),
                    largest_load_pressure_share=float(self._load[index]),
                    lowest_supply_pressure=supply if np.isfinite(supply) else 0.0,
                )
            )
        return uses


def _joined(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Return blocks (rows, samples) as one, without a copy of a single one."""
    return blocks[0] if len(blocks) == 1 else np.hstack(blocks)


def _rows(places: Iterable[int]) -> slice | np.ndarray:
    """Return rows as a slice if they are evenly spaced, which is a view without a copy; else as their numbers."""
    rows = np.fromiter(places, dtype=np.intp)
    steps = np.unique(np.diff(rows))
    if len(rows) < 2 or len(steps) != 1 or steps[0] <= 0:
        return rows
    return slice(int(rows[0]), int(rows[-1]) + 1, int(steps[0]))
