"""Time segments of a record in which a condition holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Segment:
    """A time segment of a record.

    Parameters
    ----------
    start, end : float
        Time from the record's start, s; `0 <= start < end`.
    """

    start: float
    end: float


def segments_of(holds: NDArray[np.bool_], *, sample_rate: float, largest_gap: float = 0.5) -> tuple[Segment, ...]:
    """Join the samples at which a condition holds to time segments.

    Parameters
    ----------
    holds : ndarray of bool, shape (samples,)
        Condition at each sample.
    sample_rate : float
        Sample rate, Hz, greater than 0.
    largest_gap : float
        Segments with a smaller gap between them are joined, s, 0 or more.

    Returns
    -------
    tuple of Segment
        Segments in order; empty if the condition never holds.
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
