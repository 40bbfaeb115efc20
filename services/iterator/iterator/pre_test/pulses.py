"""Drive of a pre-test: rest, then a slow and a quick small pulse on each drive in sequence, with rest after each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.limits import DriveLimits

LARGEST_LEVEL: Final = 0.05
"""Largest level as a share of the limits and slew limits of a drive."""

_REST_SECONDS: Final = 2.0
# Length of each pulse and of the rest after it. The slow one, below 8 Hz, is for forces and displacements, the quick
# one for accelerations, which a slow one hardly moves.
_PULSES: Final = ((0.2, 0.6), (0.05, 0.85))
# End of a window before the next pulse, whose level is the reference of the next window.
_GUARD_SECONDS: Final = 0.2


@dataclass(frozen=True)
class PulseTrain:
    """The drive, shape (drives, samples), the peak of each drive, and the window of each: from its pulses to the next.

    `rest`: Number of samples before the first pulse. `slow`: Samples of a window before its quick pulse. `guard`:
    Samples between a window and the next one.
    """

    drive: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    windows: tuple[slice, ...]
    rest: int
    slow: int
    guard: int


def pulse_train(limits: DriveLimits, *, sample_rate: float, level: float) -> PulseTrain:
    """Return the drive of a pre-test; each pulse goes to the side on which the drive has more room.

    `limits`: Limits of the drives. `sample_rate`: Sample rate in Hz. `level`: Share of limits and slew limits, above 0
    to `LARGEST_LEVEL`.
    """
    up, down = limits.maximum, -limits.minimum
    reach = np.where(up >= down, up, -down)
    slew = np.where(limits.slew_limit > 0.0, limits.slew_limit, np.inf)
    parts = []
    for seconds, pause in _PULSES:
        length = max(round(seconds * sample_rate), 4)
        pulse = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(length) / length))
        # Largest step of the samples: the slew limit applies to the played samples, not to the continuous curve.
        steepest = float(np.abs(np.diff(pulse, append=0.0)).max()) * sample_rate
        peak = level * np.sign(reach) * np.minimum(np.abs(reach), slew / steepest)
        parts.append(peak[:, None] * np.concatenate([pulse, np.zeros(round(pause * sample_rate))]))
    shape = np.hstack(parts)
    drives, length = shape.shape
    rest = round(_REST_SECONDS * sample_rate)
    guard = round(_GUARD_SECONDS * sample_rate)
    starts = [rest + row * length for row in range(drives)]
    windows = tuple(slice(start, start + length - guard) for start in starts)
    drive = np.zeros((drives, rest + drives * length))
    for row, start in enumerate(starts):
        drive[row, start : start + length] = shape[row]
    amplitude = shape[np.arange(drives), np.abs(shape).argmax(axis=1)]
    return PulseTrain(drive, amplitude, windows, rest, parts[0].shape[1], guard)
