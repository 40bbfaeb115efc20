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
        by_source = {source: [dog for dog in watchdogs if dog.source is source] for source in Source}
        self._dogs = [dog for dogs in by_source.values() for dog in dogs]
        self._rows = {source: np.array([dog.row for dog in dogs]) for source, dogs in by_source.items() if dogs}
        self._minimum = np.array([[dog.minimum] for dog in self._dogs])
        self._maximum = np.array([[dog.maximum] for dog in self._dogs])
        # A simulation that plays ahead asks about a block before it is published, and again then.
        self._clear: Block | None = None

    def first_trip(self, block: Block) -> Trip | None:
        """Return the earliest violation in a block; of several at one sample, the first by source and order."""
        if not self._dogs or block is self._clear:
            return None
        values = {
            Source.RESPONSE: block.response,
            Source.FOLLOWING_ERROR: block.following_error,
            Source.MONITORED: block.monitored,
        }
        # All at once, with few calls: beside a rig that plays fast, each call counts more than its work.
        watched = np.concatenate([values[source].take(rows, axis=0) for source, rows in self._rows.items()])
        # Written so that a value that is not a number is outside.
        inside = watched >= self._minimum
        inside &= watched <= self._maximum
        if np.logical_and.reduce(inside, axis=None):
            self._clear = block
            return None
        sample = int(np.argmin(inside.all(axis=0)))
        which = int(np.argmin(inside[:, sample]))
        dog, value = self._dogs[which], float(watched[which, sample])
        limit = dog.minimum if value < dog.minimum else dog.maximum
        return Trip(dog, value, limit, (block.first_sample + sample) / self._sample_rate)
