"""Real Fourier transforms along the last axis: scipy's, which transforms several channels at once, with types."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import fft


def forward(samples: NDArray[np.float64], length: int | None = None) -> NDArray[np.complex128]:
    """One-sided spectrum of each row, zero-padded to a length.

    Parameters
    ----------
    samples
        Shape (..., samples).
    length
        Samples of the transform, no fewer than there are; as many as there are where not given.

    Returns
    -------
    numpy.ndarray
        Shape (..., length // 2 + 1).
    """
    return cast(NDArray[np.complex128], fft.rfft(samples, length, axis=-1))


def backward(spectrum: NDArray[np.complex128], length: int) -> NDArray[np.float64]:
    """Real rows from their one-sided spectra: undoes `forward`.

    Parameters
    ----------
    spectrum
        Shape (..., length // 2 + 1).
    length
        Samples of the transform.

    Returns
    -------
    numpy.ndarray
        Shape (..., length).
    """
    return cast(NDArray[np.float64], fft.irfft(spectrum, length, axis=-1))


def fast_length(least: int) -> int:
    """Shortest even length from `least` upward that transforms fast.

    Parameters
    ----------
    least
        Samples needed, 1 or more.

    Returns
    -------
    int
        Even, `least` or more.
    """
    return 2 * cast(int, fft.next_fast_len((least + 1) // 2, real=True))
