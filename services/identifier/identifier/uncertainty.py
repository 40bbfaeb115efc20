"""The random error of an FRF estimated by H1."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identifier.h1 import FrfEstimate


def relative_magnitude_variance(coherence: ArrayLike, independent_averages: float) -> NDArray[np.float64]:
    """Variance of the magnitude of a single-drive FRF over its square (Eq. 11), ``(1 - g2) / (2 N g2)``.

    Parameters
    ----------
    coherence
        Coherence ``g2``, above 0 up to 1.
    independent_averages
        Equivalent independent averages ``N``, greater than 0.

    Returns
    -------
    numpy.ndarray
        Same shape as `coherence`.

    Raises
    ------
    ValueError
        Where a value is outside its range.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 11; Bendat & Piersol, *Random Data*, section 9.1.
    """
    value = np.asarray(coherence, dtype=np.float64)
    if not np.all((value > 0.0) & (value <= 1.0)):
        raise ValueError("The coherence must lie above 0 and at most at 1 at every line.")
    if not independent_averages > 0.0:
        raise ValueError(f"There are {independent_averages} independent averages; there must be more than 0.")
    return (1.0 - value) / (2.0 * independent_averages * value)


def frf_variance(estimate: FrfEstimate) -> NDArray[np.float64]:
    """Variance ``E|H - E H|^2`` of every element of an FRF matrix, from the residual spectrum and ``S_uu^-1``.

    Parameters
    ----------
    estimate
        By H1.

    Returns
    -------
    numpy.ndarray
        Shape (lines, responses, drives), response unit squared per drive unit squared; 0 outside the band:
        ``S_ee,i [S_uu^-1]_jj / (N - n_u)``. The residual of `N` averages through which `n_u` drives were fitted has
        `N - n_u` degrees of freedom. For one drive, a magnitude and many averages it is twice Eq. 11.

    Raises
    ------
    ValueError
        Where there are no more independent averages than drives.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*, chapter 9; Pintelon & Schoukens, *System Identification*, chapter 2.
    """
    drives = estimate.s_uu.shape[-1]
    freedom = estimate.independent_averages - drives
    if not freedom > 0.0:
        raise ValueError(
            f"{estimate.independent_averages:.3g} independent averages of {drives} drives leave nothing to estimate "
            "the variance from; take a longer experiment or shorter blocks."
        )
    band = np.flatnonzero(estimate.condition_number > 0.0)
    residual = estimate.response_psd[band] * (1.0 - estimate.coherence[band])
    inverse = np.einsum("fjj->fj", np.linalg.inv(estimate.s_uu[band])).real
    variance = np.zeros(estimate.frf.shape)
    variance[band] = residual[:, :, None] * inverse[:, None, :] / freedom
    return variance
