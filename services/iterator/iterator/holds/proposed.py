"""Playback proposed at a hold point, and the use of the rig's limits by its drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.assessment import Forecast
from iterator.holds.lineage import Revision
from iterator.limits import DriveLimits, DriveProjection, drive_slew


@dataclass(frozen=True, eq=False)
class ProposedPlayback:
    """The next playback before it is played.

    `number`: From 1. `level`: Share of the target that is played. `follows`: Playback that the drive was made from; 0
    for a first drive. `drive`, `last_drive`, shape (n_u, samples): As it would be played, and the drive of the playback
    it follows. `projection`: Changes that hold the limits. `forecast`: Forecast of the controlled responses.
    `refusal`: Error if no drive could be made; drive and forecast are then None.
    """

    number: int
    level: float
    follows: int
    last_drive: NDArray[np.float64] | None
    drive: NDArray[np.float64] | None = None
    projection: DriveProjection | None = None
    forecast: Forecast | None = None
    refusal: ValueError | None = None


Decide = Callable[[int, ProposedPlayback | None], Revision | None]
"""Called with the number of each playback and the proposal until it returns None: then the drive is played.

A recorded playback has no proposal: the function is called until it has returned every earlier revision.
"""


@dataclass(frozen=True)
class DriveUse:
    """Use of one drive: peak in its unit, slew per second, shares of range and slew limit, relative change of RMS."""

    peak: float
    slew: float
    range_share: float
    slew_share: float
    change: float


def drive_use(
    drive: NDArray[np.float64], last: NDArray[np.float64] | None, *, limits: DriveLimits
) -> tuple[DriveUse, ...]:
    """Return the use of the limits by each drive; `drive` and the one before, `last`, have shape (n_u, samples)."""
    peak = np.abs(drive).max(axis=1)
    slew = np.array([np.abs(drive_slew(values, limits.sample_rate)).max() for values in drive])
    room = np.where(drive > 0.0, limits.maximum[:, None], -limits.minimum[:, None])
    share = (np.abs(drive) / room).max(axis=1)
    slew_share = np.divide(slew, limits.slew_limit, out=np.zeros_like(slew), where=limits.slew_limit > 0.0)
    change = np.ones_like(peak)
    if last is not None:
        before = rms(last)
        np.divide(rms(drive - last), before, out=change, where=before > 0.0)
    return tuple(DriveUse(*map(float, row)) for row in zip(peak, slew, share, slew_share, change, strict=True))
