"""Watchdogs of a playback: limits on what is measured and achieved; the first violation of a block, or none.

They see what the sensors say, block by block: a rig ramps down at the end of the block in which one tripped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class Source(StrEnum):
    """What a watchdog looks at."""

    RESPONSE = "response"
    FOLLOWING_ERROR = "following error"
    MONITORED = "monitored value"


@dataclass(frozen=True)
class Watchdog:
    """One limit: which row of its source, and where its values have to stay.

    Parameters
    ----------
    source : Source
        What it looks at.
    name : str
        Name of the channel or monitored value.
    row : int
        Row of its source.
    unit : str
        Unit of the limits; empty for a monitored value.
    minimum, maximum : float
        Range in which the values have to stay.
    """

    source: Source
    name: str
    row: int
    unit: str
    minimum: float
    maximum: float


@dataclass(frozen=True)
class Trip:
    """What made a watchdog trip: the first value that was outside, the limit it passed, and when, in s.

    `watchdog`: The one that tripped. `value`: The first value outside, in the watchdog's unit. `limit`: The limit that
    it passed. `seconds`: Time within the run, in s; negative before the drive's first sample.
    """

    watchdog: Watchdog
    value: float
    limit: float
    seconds: float

    @property
    def sentence(self) -> str:
        """Say it, without the stop at the end."""
        dog = self.watchdog
        unit = f" {dog.unit}" if dog.unit else ""
        return (
            f"the {dog.source} of {dog.name} was {self.value:.4g}{unit} {when(self.seconds)}, "
            f"its watchdog allows {dog.minimum:g} to {dog.maximum:g}{unit}"
        )


def when(seconds: float) -> str:
    """Say a time of a run in words.

    `seconds`: Since the drive's first sample, in s; negative before it.
    Returns: Part of a sentence, such as "at 1.500 s".
    """
    return f"at {seconds:.3f} s" if seconds >= 0.0 else f"{-seconds:.3f} s before the drive began"


class WatchdogMonitor:
    """Monitor of a playback: all watchdogs of a rig, block by block.

    `watchdogs`: Of the rig that plays. `sample_rate`: In Hz.
    """

    def __init__(self, watchdogs: Sequence[Watchdog], *, sample_rate: float) -> None:
        self._sample_rate = sample_rate
        by_source = {source: tuple(dog for dog in watchdogs if dog.source is source) for source in Source}
        self._sides = {source: _Side(dogs) for source, dogs in by_source.items() if dogs}

    def first_trip(
        self, *, first_sample: int, response: np.ndarray, following_error: np.ndarray, monitored: np.ndarray
    ) -> Trip | None:
        """Look at a block.

        `first_sample`: Index of the block's first sample within the run. `response`: As measured, each row in its
        channel's unit. `following_error`: Command less achieved value, each row in its drive's unit; zero where no
        actuator follows. `monitored`: In their own units.
        Returns: The earliest violation; of several at one sample, the first in the order of the watchdogs.
        """
        values = {Source.RESPONSE: response, Source.FOLLOWING_ERROR: following_error, Source.MONITORED: monitored}
        earliest: Trip | None = None
        for source, side in self._sides.items():
            found = side.first_outside(values[source])
            if found is None:
                continue
            dog, value, sample = found
            seconds = (first_sample + sample) / self._sample_rate
            if earliest is None or seconds < earliest.seconds:
                earliest = Trip(dog, value, dog.minimum if value < dog.minimum else dog.maximum, seconds)
        return earliest


class _Side:
    """The watchdogs of one source, at least one, side by side."""

    def __init__(self, dogs: Sequence[Watchdog]) -> None:
        self._dogs = dogs
        self._rows = [dog.row for dog in dogs]
        self._minimum = np.array([[dog.minimum] for dog in dogs])
        self._maximum = np.array([[dog.maximum] for dog in dogs])

    def first_outside(self, block: np.ndarray) -> tuple[Watchdog, float, int] | None:
        """Return the first value outside, whose it is and its sample in the block."""
        rows = block[self._rows]
        # Written so that a value that is not a number is outside.
        inside = (rows >= self._minimum) & (rows <= self._maximum)
        if inside.all():
            return None
        sample = int(np.argmin(inside.all(axis=0)))
        which = int(np.argmin(inside[:, sample]))
        return self._dogs[which], float(rows[which, sample]), sample
