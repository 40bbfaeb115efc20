"""Stretches of a target that the rig cannot reach: flagged and left, not chased."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from duralab_spectra import as_record
from iterator.band import Segment, segments_of

# Over which the error's energy is averaged, and how near a saturated drive counts, s.
_WINDOW_SECONDS: Final = 1.0
# An error counts as the limit's where it is this many times what it is where no drive was at a limit.
_LARGER_ERROR: Final = 1.5
# Less than this share of the target's RMS is no miss, however good the rest is.
_SMALLEST_MISS: Final = 0.1


@dataclass(frozen=True)
class UnreachableSegment:
    """A stretch in which a response misses its target while a drive is held at its limits.

    Parameters
    ----------
    response : int
        Which one, from 0.
    segment : Segment
        When.
    relative_rms_error : float
        In it: RMS of the error over that of the whole target's channel.
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
    """Find where a response misses its target because a drive was held at the rig's limits.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        Both as judged, in the control band.
    saturated : ndarray of bool, shape (n_u, samples)
        Where each drive was held, see `DriveProjection.saturated`.
    sample_rate : float
        Hz.

    Returns
    -------
    tuple of UnreachableSegment
        By response, then in order of time; empty where no drive was held, or where the error there is like that
        elsewhere or below a tenth of the target's RMS. Where a drive was held all the time, there is no elsewhere.

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
