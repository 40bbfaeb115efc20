"""Offset and drift of a measured load from its amplifier."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record

HIGHEST_DRIFT_ORDER = 9
"""A polynomial of a higher order follows the loads themselves."""


def remove_mean(samples: ArrayLike) -> NDArray[np.float64]:
    """Take the mean off every channel.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Each row in its channel's unit.

    Returns
    -------
    ndarray, shape (channels, samples)
        Each row with a mean of 0.
    """
    record = as_record(samples)
    return record - record.mean(axis=1, keepdims=True)


def remove_drift(samples: ArrayLike, *, order: int = 1) -> NDArray[np.float64]:
    """Take the polynomial that fits best off every channel, and leave its mean.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Each row in its channel's unit.
    order : int
        1 for a straight line, up to 9; the record must have more samples.

    Returns
    -------
    ndarray, shape (channels, samples)
        Each row with the mean that it had.

    Raises
    ------
    ValueError
        Another order, or a record that is too short for it.
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
