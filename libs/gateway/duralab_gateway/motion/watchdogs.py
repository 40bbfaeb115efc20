"""Watchdogs of a playback: limits on measured and achieved values; the first violation of a block, or none.

They check the sensor signals block by block: a rig ramps down at the end of the block in which one tripped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from duralab_gateway.motion.playback import Block


class Source(StrEnum):
    """Signal that a watchdog monitors."""

    RESPONSE = "response"
    FOLLOWING_ERROR = "following error"
    MONITORED = "monitored value"


class Level(StrEnum):
    """Kind of a limit: a warning is reported, the others end the run."""

    WATCHDOG = "watchdog"
    ABORT = "abort level"
    WARNING = "warning level"


@dataclass(frozen=True)
class Watchdog:
    """One limit: the row of its source, and the allowed range of its values, in a unit; empty for a monitored value."""

    source: Source
    name: str
    row: int
    unit: str
    minimum: float
    maximum: float
    level: Level = Level.WATCHDOG


@dataclass(frozen=True)
class Trip:
    """Cause of a trip: the first value outside, the limit that it passed, and the time in s of the run."""

    watchdog: Watchdog
    value: float
    limit: float
    seconds: float

    @property
    def sentence(self) -> str:
        """Sentence of the trip, without the full stop."""
        dog = self.watchdog
        unit = f" {dog.unit}" if dog.unit else ""
        return (
            f"the {dog.source} of {dog.name} was {self.value:.4g}{unit} {when(self.seconds)}, "
            f"its {dog.level} allows {dog.minimum:g} to {dog.maximum:g}{unit}"
        )


def when(seconds: float) -> str:
    """Return a time of a run as part of a sentence, such as "at 1.500 s"; negative before the drive begins."""
    return f"at {seconds:.3f} s" if seconds >= 0.0 else f"{-seconds:.3f} s before the drive began"


class WatchdogMonitor:
    """Monitor of a playback: all watchdogs of a rig, block by block."""

    def __init__(self, watchdogs: Sequence[Watchdog], *, sample_rate: float) -> None:
        self._sample_rate = sample_rate
        by_source = {source: tuple(dog for dog in watchdogs if dog.source is source) for source in Source}
        self._sides = {source: _Side(dogs) for source, dogs in by_source.items() if dogs}

    def first_trip(self, block: Block) -> Trip | None:
        """Return the earliest violation in a block; of several at one sample, the first by the order of watchdogs."""
        values = {
            Source.RESPONSE: block.response,
            Source.FOLLOWING_ERROR: block.following_error,
            Source.MONITORED: block.monitored,
        }
        earliest: Trip | None = None
        for source, side in self._sides.items():
            found = side.first_outside(values[source])
            if found is None:
                continue
            dog, value, sample = found
            seconds = (block.first_sample + sample) / self._sample_rate
            if earliest is None or seconds < earliest.seconds:
                earliest = Trip(dog, value, dog.minimum if value < dog.minimum else dog.maximum, seconds)
        return earliest


class _Side:
    """Watchdogs of one source, at least one, as arrays."""

    def __init__(self, dogs: Sequence[Watchdog]) -> None:
        self._dogs = dogs
        self._rows = np.array([dog.row for dog in dogs])
        self._minimum = np.array([[dog.minimum] for dog in dogs])
        self._maximum = np.array([[dog.maximum] for dog in dogs])

    def first_outside(self, block: np.ndarray) -> tuple[Watchdog, float, int] | None:
        """Return the watchdog and value of the first violation, and its sample in the block."""
        rows = block.take(self._rows, axis=0)
        # Written so that a value that is not a number is outside.
        inside = rows >= self._minimum
        inside &= rows <= self._maximum
        # As `inside.all()`, which costs a rig that plays fast more than all the rest.
        if np.logical_and.reduce(inside, axis=None):
            return None
        sample = int(np.argmin(inside.all(axis=0)))
        which = int(np.argmin(inside[:, sample]))
        return self._dogs[which], float(rows[which, sample]), sample
