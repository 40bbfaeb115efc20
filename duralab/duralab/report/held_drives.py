"""Segments in which a drive is held at a limit of its actuator, so that the target is out of reach."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from duralab.data import Signals

NEAR: Final = 0.99
"""Of a limit: from here on a drive is at it. The iterator leaves half a percent where it holds a drive."""

JOINED_SECONDS: Final = 0.1
"""Stretches that are closer to each other than this count as one."""


class Limit(StrEnum):
    """Kind of an actuator's limit."""

    TRAVEL = "travel"
    SPEED = "speed"


@dataclass(frozen=True)
class HeldStretch:
    """A stretch of a drive in which it is at a limit.

    `drive`: Name of the channel. `limit`: Travel or speed. `start`, `end`: In seconds. `held_seconds`: How long it is
    at the limit within the stretch.
    """

    drive: str
    limit: Limit
    start: float
    end: float
    held_seconds: float


def held_stretches(drive: Signals) -> list[HeldStretch]:
    """Return where a drive is at its limits, channel by channel and in order."""
    found = []
    for channel, samples in zip(drive.channels, drive.samples, strict=True):
        # A limit of 0 that is only stated as a rest position is none; an unlimited one is infinite.
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
    """Return first sample, the one after the last, and how many are held, of each stretch."""
    places = np.flatnonzero(where)
    if not places.size:
        return []
    groups = np.split(places, np.flatnonzero(np.diff(places) > gap) + 1)
    return [(int(group[0]), int(group[-1]) + 1, int(group.size)) for group in groups]
