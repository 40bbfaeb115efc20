"""Level crossings, time at level and range exceedance of a load."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_loads.load_cycles import LoadCycles, as_signal


def count_level_crossings(signal: ArrayLike, levels: ArrayLike) -> NDArray[np.intp]:
    """Count how often a signal rises through each level.

    Parameters
    ----------
    signal : array_like, shape (samples,)
        Finite signal.
    levels : array_like, shape (levels,)
        Levels in the signal's unit, in any order.

    Returns
    -------
    ndarray, shape (levels,)
        Number of steps from below a level to it or beyond; a signal that returns to its start falls through it as
        often.

    Raises
    ------
    ValueError
        If there is no signal, several channels, or a value that is not finite.

    Notes
    -----
    Source: ASTM E1049-85, section 5.1, level-crossing counting, without its restriction to one side of the mean.
    """
    values = as_signal(signal)
    wanted = np.asarray(levels, dtype=np.float64)
    before, after = values[:-1], values[1:]
    rising = after > before
    # Levels in (before, after] of all rising steps: those from which no step has begun less those it has passed.
    began = np.searchsorted(np.sort(before[rising]), wanted, side="left")
    passed = np.searchsorted(np.sort(after[rising]), wanted, side="left")
    return (began - passed).astype(np.intp)


def share_of_time_at_level(signal: ArrayLike, edges: ArrayLike) -> NDArray[np.float64]:
    """Return the share of the time that a signal spends between levels.

    Parameters
    ----------
    signal : array_like, shape (samples,)
        Finite signal.
    edges : array_like, shape (bins + 1,)
        Edges in the signal's unit, rising; each bin holds its lower edge, the last one its upper edge too.

    Returns
    -------
    ndarray, shape (bins,)
        Shares, 0 to 1; their sum is 1 if the edges hold the whole signal.

    Raises
    ------
    ValueError
        If there is no signal, several channels, a value that is not finite, or edges that do not rise.
    """
    values = as_signal(signal)
    bounds = np.asarray(edges, dtype=np.float64)
    if bounds.ndim != 1 or bounds.size < 2 or not np.all(np.diff(bounds) > 0.0):
        raise ValueError("The edges of the levels do not rise; give two or more, each above the one before.")
    return np.histogram(values, bins=bounds)[0] / values.size


def count_exceeded_ranges(cycles: LoadCycles, ranges: ArrayLike) -> NDArray[np.float64]:
    """Count the cycles of a given range or more: the range-pair diagram.

    Parameters
    ----------
    cycles : LoadCycles
        Cycles of one signal.
    ranges : array_like, shape (ranges,)
        Ranges in the signal's unit, in any order.

    Returns
    -------
    ndarray, shape (ranges,)
        Number of cycles, half cycles counted as halves; never rising with the range.
    """
    order = np.argsort(cycles.ranges)
    smaller = np.searchsorted(cycles.ranges[order], np.asarray(ranges, dtype=np.float64), side="left")
    below = np.concatenate([[0.0], np.cumsum(cycles.counts[order])])
    return below[-1] - below[smaller]
