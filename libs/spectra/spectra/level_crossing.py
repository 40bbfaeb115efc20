"""How often a signal rises through each of a row of levels."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spectra.records import as_record


def count_level_crossings(samples: ArrayLike, levels: ArrayLike) -> NDArray[np.int64]:
    """Count how often each channel rises from below a level to it or above it.

    Parameters
    ----------
    samples
        Shape (channels, samples).
    levels
        Shape (levels), rising, finite, in the unit of the channels.

    Returns
    -------
    numpy.ndarray
        Shape (channels, levels), 0 or more. A signal that ends where it began falls through each level as often.

    Raises
    ------
    ValueError
        Where the record is not allowed or the levels do not rise.

    Notes
    -----
    Source: ASTM E1049-85, section 5.1, level-crossing counting, with rises counted below the reference level as well.
    """
    record = as_record(samples)
    thresholds = np.atleast_1d(np.asarray(levels, dtype=np.float64))
    if thresholds.ndim != 1 or not np.isfinite(thresholds).all() or np.any(np.diff(thresholds) <= 0.0):
        raise ValueError("The levels must be one row of finite, rising values; sort them and leave out doubles.")
    counts = np.empty((record.shape[0], thresholds.size), dtype=np.int64)
    for channel, values in enumerate(record):
        # How many levels each sample has reached: a rise from a to b passes the levels a to b - 1.
        reached = np.searchsorted(thresholds, values, side="right")
        before, after = reached[:-1], reached[1:]
        rises = after > before
        starts = np.bincount(before[rises], minlength=thresholds.size + 1)
        ends = np.bincount(after[rises], minlength=thresholds.size + 1)
        counts[channel] = np.cumsum(starts - ends)[: thresholds.size]
    return counts
