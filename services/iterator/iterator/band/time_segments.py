"""Stretches of a record in which something holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Segment:
    """A stretch of a record.

    Parameters
    ----------
    start, end : float
        From the record's start, s; `0 <= start < end`.
    """

    start: float
    end: float


def segments_of(holds: NDArray[np.bool_], *, sample_rate: float, largest_gap: float = 0.5) -> tuple[Segment, ...]:
    """Join the samples at which something holds to stretches of time.

    Parameters
    ----------
    holds : ndarray of bool, shape (samples,)
        At each sample.
    sample_rate : float
        Hz, greater than 0.
    largest_gap : float
        Stretches that are less than this apart are one, s, 0 or more.

    Returns
    -------
    tuple of Segment
        In order, except one another; empty where it holds nowhere.
    """
    where = np.flatnonzero(holds)
    if where.size == 0:
        return ()
    breaks = np.flatnonzero(np.diff(where) - 1 >= max(1.0, largest_gap * sample_rate))
    first = where[np.concatenate([[0], breaks + 1])]
    last = where[np.concatenate([breaks, [where.size - 1]])]
    return tuple(
        Segment(start=float(a) / sample_rate, end=float(b + 1) / sample_rate) for a, b in zip(first, last, strict=True)
    )
