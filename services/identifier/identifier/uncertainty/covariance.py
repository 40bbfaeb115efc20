"""Random error of an estimated FRF matrix: its covariance, and Eq. 11 of the paper for one drive."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def relative_magnitude_variance(coherence: ArrayLike, independent_averages: float) -> NDArray[np.float64]:
    """Return the variance of a single-drive FRF's magnitude over its square (Eq. 11), ``(1 - g2) / (2 N g2)``.

    Parameters
    ----------
    coherence
        Coherence ``g2``, any shape, above 0 up to 1.
    independent_averages
        Equivalent independent averages ``N``, greater than 0.

    Returns
    -------
    numpy.ndarray
        Same shape as `coherence`.

    Raises
    ------
    ValueError
        A value is outside its range.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 11; Bendat & Piersol, *Random Data*, section 9.1.
    """
    value = np.asarray(coherence, dtype=np.float64)
    if not np.all((value > 0.0) & (value <= 1.0)):
        worst = value[~((value > 0.0) & (value <= 1.0))].flat[0]
        raise ValueError(f"A coherence is {worst}; it must lie above 0 and at most at 1 at every line.")
    if not independent_averages > 0.0:
        raise ValueError(f"There are {independent_averages} independent averages; there must be more than 0.")
    return (1.0 - value) / (2.0 * independent_averages * value)


def row_covariance(s_uu: NDArray[np.complex128], *, averages: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the covariance of the elements of a row of the FRF, for a residual of unit density.

    A row (one response) that is fitted by least squares through `N` averages of the drives has the covariance
    ``E[d_j conj(d_k)] = S_ee [S_uu^-1]_kj / N``, ``d`` its error and ``S_ee`` the density of the part that the drives
    do not explain, without the bias of the fit. One matrix serves all rows; `element_variance` puts both together.

    Parameters
    ----------
    s_uu
        Complex, shape (lines, drives, drives), one-sided density ``E[U U^H]``.
    averages
        Shape (lines): equivalent independent averages of the FRF at each line, 0 without an estimate.

    Returns
    -------
    numpy.ndarray
        Complex, shape (lines, drives, drives), Hermitian, in Hz per drive unit squared; 0 without an estimate.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*, chapter 9; Pintelon & Schoukens, *System Identification*, chapter 2.
    """
    covariance = np.zeros_like(s_uu)
    lines = averages > 0.0
    power = np.sqrt(np.einsum("fjj->fj", s_uu[lines]).real)
    scale = power[:, :, None] * power[:, None, :]
    # Inverted at unit diagonal, so that the drives' units do not reduce the precision.
    inverse = np.linalg.inv(s_uu[lines] / scale) / scale
    covariance[lines] = inverse.transpose(0, 2, 1) / averages[lines, None, None]
    return covariance


def element_variance(residual_psd: NDArray[np.float64], row_covariance: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the variance ``E|H - E H|^2`` of every element of an FRF matrix.

    Parameters
    ----------
    residual_psd
        Shape (lines, responses), one-sided density of the part that the drives do not explain.
    row_covariance
        Shape (lines, drives, drives), see the function of that name.

    Returns
    -------
    numpy.ndarray
        Shape (lines, responses, drives), response unit squared per drive unit squared. For one drive, a magnitude and
        many averages it is twice Eq. 11.
    """
    return residual_psd[:, :, None] * np.einsum("fjj->fj", row_covariance).real[:, None, :]
