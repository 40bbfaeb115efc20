"""Spectral lines: their frequencies, and smoothing over neighbours."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.records import require_sample_rate


def line_frequencies(block_samples: int, sample_rate: float) -> NDArray[np.float64]:
    """Return the frequencies of the one-sided spectrum of a block.

    Parameters
    ----------
    block_samples
        Number of samples in a block, 2 or more.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Frequencies, shape (block_samples // 2 + 1), in hertz, from 0 upward.

    Raises
    ------
    ValueError
        If the block is too short or the sample rate is not positive.
    """
    require_sample_rate(sample_rate)
    if block_samples < 2:
        raise ValueError(f"The block has {block_samples} samples; it must have 2 or more.")
    return np.arange(block_samples // 2 + 1, dtype=np.float64) * (sample_rate / block_samples)


def smooth_lines(spectra: ArrayLike, weights: ArrayLike = (1.0, 2.0, 3.0, 2.0, 1.0)) -> NDArray:
    """Return the weighted mean of each line with its neighbours.

    Parameters
    ----------
    spectra
        Spectra, shape (lines, ...), real or complex.
    weights
        Shape (weights): an odd number of positive ones, the middle one for the line itself. At the first and last lines
        only the existing neighbours count, so a constant is not changed.

    Returns
    -------
    numpy.ndarray
        Smoothed spectra, of the shape and kind of `spectra`.

    Raises
    ------
    ValueError
        If the weights are not an odd number of positive values, or outnumber the lines.
    """
    values = np.asarray(spectra)
    kernel = np.asarray(weights, dtype=np.float64)
    if kernel.ndim != 1 or kernel.size % 2 == 0 or not np.all(kernel > 0.0):
        raise ValueError(f"The weights are {kernel.tolist()}; they must be an odd number of positive values.")
    lines = values.shape[0] if values.ndim else 0
    if lines < kernel.size:
        raise ValueError(f"{lines} lines cannot be smoothed with {kernel.size} weights; use fewer weights.")
    half = kernel.size // 2
    total = np.zeros(values.shape, dtype=np.result_type(values.dtype, np.float64))
    norm = np.zeros(lines)
    for offset, weight in zip(range(-half, half + 1), kernel, strict=True):
        target = slice(max(0, -offset), min(lines, lines - offset))
        source = slice(max(0, offset), min(lines, lines + offset))
        total[target] += weight * values[source]
        norm[target] += weight
    return total / norm.reshape((lines,) + (1,) * (values.ndim - 1))
