"""Segments of a target that the rig cannot reach: reported, and excluded from corrections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from duralab_spectra import as_record
from iterator.band import Segment, segments_of

# Window in s in which the error's energy is averaged, and in which a saturated drive counts.
_WINDOW_SECONDS: Final = 1.0
# An error is caused by the limit if it is this many times the error without any drive at a limit.
_LARGER_ERROR: Final = 1.5
# An error below this share of the target's RMS is not reported, regardless of the rest.
_SMALLEST_MISS: Final = 0.1


@dataclass(frozen=True)
class UnreachableSegment:
    """Segment in which a response misses its target while a drive is held at its limits.

    Parameters
    ----------
    response : int
        Row of the response, from 0.
    segment : Segment
        Time segment.
    relative_rms_error : float
        RMS of the error in the segment over that of the whole target's channel.
    """

    response: int
    segment: Segment
    relative_rms_error: float


def unreachable_segments(
    target: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    saturated: NDArray[np.bool_],
    sample_rate: float,
) -> tuple[UnreachableSegment, ...]:
    """Find segments in which a response misses its target because a drive was held at the rig's limits.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        Target and judged response, in the control band.
    saturated : ndarray of bool, shape (n_u, samples)
        Samples at which each drive was held, see `DriveProjection.saturated`.
    sample_rate : float
        Sample rate, Hz.

    Returns
    -------
    tuple of UnreachableSegment
        Segments by response, then in order of time; empty if no drive was held, or if the error in them is like
        that elsewhere or below a tenth of the target's RMS. If a drive was held all the time, there is no elsewhere.

    Raises
    ------
    ValueError
        The records' lengths differ or a value is not finite.
    """
    wanted, measured = as_record(target, name="target"), as_record(response, name="response")
    if wanted.shape != measured.shape or saturated.shape[1] != wanted.shape[1]:
        raise ValueError(
            f"The target has the shape {wanted.shape}, the response {measured.shape} and the saturation "
            f"{saturated.shape}; they must be of the same instants."
        )
    window = max(1, round(_WINDOW_SECONDS * sample_rate))
    held = uniform_filter1d(saturated.any(axis=0).astype(np.float64), window, mode="constant") > 0.5 / window
    if not held.any():
        return ()
    found: list[UnreachableSegment] = []
    for i in range(wanted.shape[0]):
        energy = (wanted[i] - measured[i]) ** 2
        elsewhere = float(energy[~held].mean()) if not held.all() else 0.0
        local = uniform_filter1d(energy, window, mode="nearest")
        level = float(np.mean(wanted[i] ** 2))
        missed = held & (local > max(_LARGER_ERROR**2 * elsewhere, _SMALLEST_MISS**2 * level))
        for segment in segments_of(missed, sample_rate=sample_rate):
            inside = energy[round(segment.start * sample_rate) : round(segment.end * sample_rate)]
            error = float(np.sqrt(inside.mean() / level)) if level > 0.0 else np.inf
            found.append(UnreachableSegment(response=i, segment=segment, relative_rms_error=error))
    return tuple(found)
