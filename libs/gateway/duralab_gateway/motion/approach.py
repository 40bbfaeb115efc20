"""How a rig gets to the first sample of a drive, and back to rest from wherever it is: commands along a cosine.

What is slow and smooth does not excite the specimen: a raised cosine of a second holds next to nothing above 2 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field


class Approach(BaseModel):
    """Times of a rig's way to a drive's first sample and back; a slew limit makes a ramp longer."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    #: From rest to the first sample, in s; 0 for a rig that may begin with a step.
    ramp: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: How long the first sample is held before the drive begins, in s.
    settle: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: From where a playback is left to zero, in s, and how long zero is held then. Whoever stops a rig waits for both.
    ramp_down: Annotated[float, Field(gt=0.0, le=10.0)] = 0.5
    hold: Annotated[float, Field(ge=0.0, le=10.0)] = 0.1


class Ramped(Protocol):
    """A drive channel, as far as a ramp needs it."""

    @property
    def slew_limit(self) -> float:
        """Largest rate, in unit per second; 0 where none is stated."""
        ...


def lead_in(approach: Approach, first: np.ndarray, channels: Sequence[Ramped], sample_rate: float) -> np.ndarray:
    """Return the commands from rest to a drive's first sample.

    `approach`: Of the rig. `first`: The drive's first sample, each value in its channel's unit. `channels`: The drives.
    `sample_rate`: In Hz.
    Returns: Its last column is the drive's first sample. No samples where that is zero, or where the rig begins with a
    step.
    """
    if approach.ramp == 0.0 or not first.any():
        return first[:, None]
    samples = _ramp_samples(approach.ramp, first, channels, sample_rate)
    rise = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, samples + 1)))
    # One exactly where it settles.
    shape = np.concatenate([rise[:-1], np.ones(round(approach.settle * sample_rate) + 1)])
    return first[:, None] * shape


def lead_out(approach: Approach, heading: np.ndarray, channels: Sequence[Ramped], sample_rate: float) -> np.ndarray:
    """Return the commands from where a rig is heading to zero.

    `approach`: Of the rig. `heading`: The command that the rig is on its way to, each value in its channel's unit.
    `channels`: The drives. `sample_rate`: In Hz.
    Returns: Zero exactly from the end of the ramp on; the last column is only looked ahead to.
    """
    samples = _ramp_samples(approach.ramp_down, heading, channels, sample_rate)
    fall = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, samples + 1)))
    shape = np.concatenate([fall[:-1], np.zeros(round(approach.hold * sample_rate) + 1)])
    return heading[:, None] * shape


def _ramp_samples(seconds: float, height: np.ndarray, channels: Sequence[Ramped], sample_rate: float) -> int:
    """Return the length of a ramp of these heights: a raised cosine of height h in T moves at pi h / (2 T) at most."""
    needed = [
        0.5 * np.pi * abs(value) / channel.slew_limit
        for value, channel in zip(height, channels, strict=True)
        if channel.slew_limit > 0.0
    ]
    return int(np.ceil(max(seconds, *needed, 0.0) * sample_rate))
