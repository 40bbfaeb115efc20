"""Repeatability of a rig: playbacks of one drive, compared with each other and with the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import as_record, noise_floor, rms


@dataclass(frozen=True)
class Repeatability:
    """Several playbacks of one drive against its target; arrays have one value for each response.

    All values are relative to the target's RMS, and NaN if the target is silent.

    Parameters
    ----------
    playbacks : int
        Number of playbacks, 2 or more.
    noise_floor : ndarray, shape (n_y,)
        RMS difference of one playback from the mean of many: no drive gets below it.
    relative_rms_error : ndarray, shape (n_y,)
        Root mean square over the playbacks of the relative RMS error.
    systematic_error : ndarray, shape (n_y,)
        Estimate of the error without the noise: `sqrt(e² - n²)`, 0 if the noise explains the whole error.
    """

    playbacks: int
    noise_floor: NDArray[np.float64]
    relative_rms_error: NDArray[np.float64]
    systematic_error: NDArray[np.float64]


def judge_repeatability(target: NDArray[np.float64], responses: Sequence[NDArray[np.float64]]) -> Repeatability:
    """Compare playbacks of one drive.

    Parameters
    ----------
    target : ndarray, shape (n_y, samples)
        In the control band, response units.
    responses : sequence of ndarray, shape (n_y, samples)
        Each measured with the same drive, in the control band; two or more.

    Returns
    -------
    Repeatability
        Figures of all playbacks.

    Raises
    ------
    ValueError
        Fewer than two playbacks, shapes that differ, or values that are not finite.

    Notes
    -----
    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, sample variance over periods.
    """
    wanted = as_record(target, name="target")
    level = rms(wanted)
    floor = noise_floor(responses)
    power = np.mean([np.mean((wanted - response) ** 2, axis=1) for response in responses], axis=0)
    systematic = np.sqrt(np.maximum(power - floor**2, 0.0))
    return Repeatability(
        len(responses),
        *(
            np.divide(value, level, out=np.full_like(level, np.nan), where=level > 0.0)
            for value in (floor, np.sqrt(power), systematic)
        ),
    )
