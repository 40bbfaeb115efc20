"""Error of an estimated FRF matrix at each line, and its bias and scatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def relative_error(
    estimated: NDArray[np.complex128], true: NDArray[np.complex128], *, levels: Sequence[float]
) -> NDArray[np.float64]:
    """Error of an FRF matrix at each line, every drive and response counting alike.

    Columns are multiplied by the drives' levels, rows divided by their own RMS over the lines: then the units are gone,
    and what is compared is the size of the matrices (Frobenius norm) at that line.

    Parameters
    ----------
    estimated, true
        Complex, shape (lines, responses, drives).
    levels
        RMS of each drive, in its unit.

    Returns
    -------
    numpy.ndarray
        Shape (lines), 0 or more.
    """
    by_level = true * np.asarray(levels)
    row = np.sqrt(np.mean(np.sum(np.abs(by_level) ** 2, axis=2), axis=0))
    difference = (estimated - true) * np.asarray(levels) / row[:, None]
    size = np.linalg.norm(by_level / row[:, None], axis=(1, 2))
    return np.linalg.norm(difference, axis=(1, 2)) / size


def bias_and_scatter(
    estimates: Sequence[NDArray[np.complex128]], true: NDArray[np.complex128], *, levels: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Split the error of repeated experiments into what stays and what changes from one to the next.

    Parameters
    ----------
    estimates
        From experiments that differ in their seed only, 2 or more; complex, shape (lines, responses, drives).
    true
        Same shape.
    levels
        RMS of each drive, in its unit.

    Returns
    -------
    tuple of numpy.ndarray
        Bias, the error of the mean of all; and scatter, the standard deviation of one; each of shape (lines), relative.
        With n experiments, the uncertainty of the bias is at least the scatter over the square root of n.
    """
    mean = np.mean(estimates, axis=0)
    deviation = [relative_error(true + each - mean, true, levels=levels) for each in estimates]
    scatter = np.sqrt(np.sum(np.square(deviation), axis=0) / (len(estimates) - 1))
    return relative_error(mean, true, levels=levels), scatter


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the root mean square over the lines, which, unlike a median, includes lines with large errors."""
    return float(np.sqrt(np.mean(np.square(values))))
