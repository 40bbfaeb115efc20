"""Offset and drift of a measured load from its amplifier."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record

HIGHEST_DRIFT_ORDER = 9
"""Highest order of a drift polynomial: a higher one follows the loads themselves."""


def remove_mean(samples: ArrayLike) -> NDArray[np.float64]:
    """Remove the mean of every channel.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.

    Returns
    -------
    ndarray, shape (channels, samples)
        Record with a mean of 0 in each row.
    """
    record = as_record(samples)
    return record - record.mean(axis=1, keepdims=True)


def remove_drift(samples: ArrayLike, *, order: int = 1) -> NDArray[np.float64]:
    """Remove the polynomial that fits best from every channel, and keep its mean.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    order : int
        Order of the polynomial: 1 for a straight line, up to 9; the record must have more samples.

    Returns
    -------
    ndarray, shape (channels, samples)
        Record with the mean of each row unchanged.

    Raises
    ------
    ValueError
        If the order is not allowed or the record is too short for it.
    """
    record = as_record(samples)
    if not 1 <= order <= HIGHEST_DRIFT_ORDER:
        raise ValueError(f"The order of the drift is {order}; it must be 1 to {HIGHEST_DRIFT_ORDER}.")
    if record.shape[1] <= order:
        raise ValueError(f"The record has {record.shape[1]} samples; a drift of order {order} needs more than that.")
    time = np.linspace(-1.0, 1.0, record.shape[1])
    # Legendre polynomials are nearly orthogonal on an even grid: the fit is as exact as the arithmetic.
    drift = legendre.legval(time, legendre.legfit(time, record.T, order))
    return record - (drift - drift.mean(axis=1, keepdims=True))
