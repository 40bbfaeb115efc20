"""Actuators that follow a drive no faster than a limit, as a hydraulic cylinder whose valve is at its stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

# Distance from the motion without a limit, as a share of the largest step, at which the limit is forgotten.
_FORGOTTEN: Final = 1e-3


@dataclass(frozen=True)
class RateLimit:
    """An actuator's motion `x` follows a drive `u` with `x' = clip(ω (u - x), ±rate)`.

    `corner`: `ω / 2π`, Hz, greater than 0. `rate`: Largest speed, drive units per second, greater than 0.
    """

    corner: float
    rate: float

    def motion(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the FRF from the drive to the speed of the actuator, over the limit: it is reached at 1."""
        spin, turn = 2.0 * np.pi * self.corner, 2j * np.pi * frequency
        return np.asarray(turn * spin / (turn + spin) / self.rate, dtype=np.complex128)

    def held_back(
        self, drive: NDArray[np.float64], *, sample_rate: float, where: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return `w - u`, where `w = x + x' / ω` is the drive that gives the same motion without a limit.

        `drive`, shape (samples,): From rest. `sample_rate`: Hz. `where`, shape (samples,): Where the limit may be
        reached first.
        Returns: Zero wherever the limit is not reached, shape (samples,).
        """
        # The import takes a third of a second, and a service must start at once.
        from scipy.signal import lfilter

        share = 1.0 - float(np.exp(-2.0 * np.pi * self.corner / sample_rate))
        largest = self.rate / sample_rate
        free = cast(NDArray[np.float64], lfilter([share], [1.0, share - 1.0], drive))
        missing = np.zeros_like(drive)
        end = 0
        for start in np.flatnonzero(where & (np.abs(np.diff(free, prepend=0.0)) > largest)).tolist():
            if start < end:
                continue
            motion = free.item(start - 1) if start else 0.0
            for end in range(start, drive.size):
                wanted = share * (drive.item(end) - motion)
                step = min(max(wanted, -largest), largest)
                motion += step
                if step != wanted:
                    missing[end] = (step - wanted) / share
                elif abs(motion - free.item(end)) < _FORGOTTEN * largest:
                    break
        return missing


def equivalent_drive(
    drive: NDArray[np.float64],
    limits: Sequence[RateLimit | None],
    *,
    sample_rate: float,
    where: NDArray[np.bool_] | bool = True,
) -> NDArray[np.float64]:
    """Return the drive that moves the actuators as `drive` does, if they had no limits.

    `drive`, shape (n_u, samples): From rest. `limits`: Of each drive; None if it has none. `sample_rate`: Hz. `where`,
    shape (samples,): Where a limit may be reached first.
    Returns: The same drive if no limit is reached. Its content is not limited to the band of `drive`.
    """
    if not any(limits):
        return drive
    reached = np.broadcast_to(where, drive.shape[1:])
    result = drive.copy()
    for row, limit in enumerate(limits):
        if limit is not None:
            result[row] += limit.held_back(drive[row], sample_rate=sample_rate, where=reached)
    return result
