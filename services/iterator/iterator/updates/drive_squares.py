"""Step with compensation for the squares of the drives: their effect is predicted and removed before the playback."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.band import ControlBand
from iterator.model import drive_without
from iterator.updates.basic_twr import StepStart

# Number of evaluations of the squares' effect, each as expensive as a step of basic TWR. The rest is learned from the
# playback.
_LOOKS: Final = 3
# Share of the drives' RMS below which a correction needs no further evaluation.
_SETTLED: Final = 0.01


def drive_for_squares(
    drive: NDArray[np.float64], start: StepStart, *, square_frf: NDArray[np.complex128], band: ControlBand
) -> NDArray[np.float64]:
    """Correct a next drive for the change of its squares' effect against the drive it starts from.

    A suspension's arm moves its wheel on an arc: the lateral force follows the square of the vertical stroke. A
    linear step corrects that one playback later. Here `u = u_linear - Ĥ† Q B (u² - u_start²)` is solved by fixed point
    iteration, with `B` from `secant_fit`.
    """
    before, level = np.square(start.drive), np.maximum(rms(drive), np.finfo(np.float64).tiny)

    def left(found: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        wanted = drive_without(
            start.model, np.square(found) - before, by=square_frf, band=band, drive=drive, step_gain=start.step_gain
        )
        wanted -= found
        return wanted, float(np.sqrt(np.mean((rms(wanted) / level) ** 2)))

    found = drive
    correction, size = left(found)
    share = 1.0
    for _ in range(_LOOKS - 1):
        if size <= _SETTLED:
            break
        tried = found + share * correction
        next_correction, next_size = left(tried)
        if next_size < size:
            found, correction, size = tried, next_correction, next_size
        else:
            share *= 0.5
    # The last correction is applied without another evaluation if the iteration has converged so far.
    return found + correction if share == 1.0 else found
