"""Power spectral densities of a target and a response for an overlay plot, and their coherence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import as_record, auto_spectra, line_frequencies, paired_spectra


@dataclass(frozen=True)
class SpectrumOverlay:
    """Power spectral densities of target and response for an overlay plot.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Frequencies, Hz.
    target, response, error : ndarray, shape (lines, n_y)
        Densities, response unit squared per Hz.
    coherence : ndarray, shape (lines, n_y)
        Coherence of the response with the target, 0 to 1; 0 at lines where either has no energy.
    """

    frequency: NDArray[np.float64]
    target: NDArray[np.float64]
    response: NDArray[np.float64]
    error: NDArray[np.float64]
    coherence: NDArray[np.float64]


def overlay_spectra(
    target: NDArray[np.float64], response: NDArray[np.float64], *, sample_rate: float, block_samples: int
) -> SpectrumOverlay:
    """Estimate the spectra of a target, a response and their difference.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        Records in the same units.
    sample_rate : float
        Sample rate, Hz.
    block_samples : int
        Block length, even, 2 or more; half of each block overlaps the next.

    Returns
    -------
    SpectrumOverlay
        Welch estimates.

    Raises
    ------
    ValueError
        Shapes that differ, values that are not finite, or records shorter than a block.
    """
    wanted, measured = as_record(target, name="target"), as_record(response, name="response")
    psd, power, error = (
        auto_spectra(signal, block_samples=block_samples, overlap=0.5, sample_rate=sample_rate)
        for signal in (wanted, measured, wanted - measured)
    )
    cross = paired_spectra(measured, wanted, block_samples=block_samples, overlap=0.5, sample_rate=sample_rate)
    product = psd * power
    coherence = np.divide(np.abs(cross) ** 2, product, out=np.zeros_like(product), where=product > 0.0)
    return SpectrumOverlay(
        frequency=line_frequencies(block_samples, sample_rate),
        target=psd,
        response=power,
        error=error,
        # Rounding can make a coherence of 1 greater than 1.
        coherence=np.minimum(coherence, 1.0),
    )
