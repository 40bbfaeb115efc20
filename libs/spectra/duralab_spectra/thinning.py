"""Thinning of a drawn curve: fewer points, every peak kept."""

from __future__ import annotations

import numpy as np


def piece_extremes(values: np.ndarray, length: int) -> np.ndarray:
    """Return the indices of the smallest and the largest value of each piece of a curve.

    Parameters
    ----------
    values : np.ndarray, shape (points)
        Ordinates in any unit; at least 1.
    length : int
        Number of points of a piece, 1 or more; the last piece has the rest.

    Returns
    -------
    np.ndarray of int, shape (pieces, 2)
        Index of the smallest, and of the largest value.
    """
    whole = values.size // length * length
    table = values[:whole].reshape(-1, length)
    starts = np.arange(0, whole, length)
    found = np.column_stack([starts + table.argmin(axis=1), starts + table.argmax(axis=1)])
    if rest := values[whole:].size:
        last = values[-rest:]
        found = np.vstack([found, [whole + last.argmin(), whole + last.argmax()]])
    return found


def drawn_points(values: np.ndarray, length: int) -> np.ndarray:
    """Choose the points of a curve that are drawn: the extremes of each piece, the first and the last point.

    Parameters
    ----------
    values : np.ndarray, shape (points)
        Ordinates in any unit; at least 1.
    length : int
        Number of points of a piece, 1 or more; pieces of 1 or 2 points keep all.

    Returns
    -------
    np.ndarray of int, shape (chosen)
        Ascending indices; neighbouring curves still join without a gap.
    """
    if length <= 2 or values.size <= length:
        return np.arange(values.size)
    indices = np.concatenate([[0], np.sort(piece_extremes(values, length), axis=1).ravel(), [values.size - 1]])
    # Ascending already: only neighbours can be equal.
    return indices[np.diff(indices, prepend=-1) > 0]
