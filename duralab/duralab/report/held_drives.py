"""Segments in which a drive is held at a limit of its actuator, so that the target is unreachable."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from duralab.data import Signals

NEAR: Final = 0.99
"""Share of a limit from which a drive counts as at the limit; the iterator holds drives at 99.5 %."""

JOINED_SECONDS: Final = 0.1
"""Segments with a smaller gap are joined."""


class Limit(StrEnum):
    """Kind of an actuator's limit."""

    TRAVEL = "travel"
    SPEED = "speed"


@dataclass(frozen=True)
class HeldStretch:
    """Segment of a drive at a limit.

    `drive`: Name of the channel. `limit`: Travel or speed. `start`, `end`: Start and end in seconds. `held_seconds`:
    Time at the limit within the segment.
    """

    drive: str
    limit: Limit
    start: float
    end: float
    held_seconds: float


def held_stretches(drive: Signals) -> list[HeldStretch]:
    """Return the segments in which a drive is at its limits, channel by channel and in order."""
    found = []
    for channel, samples in zip(drive.channels, drive.samples, strict=True):
        # A limit of 0 is a rest position, not a limit; a drive without a limit has infinity.
        travel = np.zeros(samples.size, dtype=bool)
        if channel.maximum > 0.0:
            travel |= samples >= NEAR * channel.maximum
        if channel.minimum < 0.0:
            travel |= samples <= NEAR * channel.minimum
        held = {Limit.TRAVEL: travel}
        if channel.slew_limit > 0.0:
            held[Limit.SPEED] = _speed(samples, drive.sample_rate) >= NEAR * channel.slew_limit
        for limit, where in held.items():
            found += [
                HeldStretch(channel.name, limit, *(samples / drive.sample_rate for samples in stretch))
                for stretch in _stretches(where, gap=round(JOINED_SECONDS * drive.sample_rate))
            ]
    return found


def largest_speed(samples: np.ndarray, sample_rate: float) -> float:
    """Return the largest magnitude of a drive's slope."""
    return float(_speed(samples, sample_rate).max())


def _speed(samples: np.ndarray, sample_rate: float) -> np.ndarray:
    return np.abs(np.diff(samples, append=samples[-1:])) * sample_rate


def _stretches(where: np.ndarray, *, gap: int) -> list[tuple[int, int, int]]:
    """Return the first sample, the one after the last, and the number of held samples of each segment."""
    places = np.flatnonzero(where)
    if not places.size:
        return []
    groups = np.split(places, np.flatnonzero(np.diff(places) > gap) + 1)
    return [(int(group[0]), int(group[-1]) + 1, int(group.size)) for group in groups]
