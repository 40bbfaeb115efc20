"""Real Fourier transforms along the last axis: scipy's, which transforms several channels at once, with types."""

from typing import cast

import numpy as np
import scipy  # imports scipy.fft on first use, which takes 0.2 s
from numpy.typing import NDArray


def forward(samples: NDArray[np.float64], length: int | None = None) -> NDArray[np.complex128]:
    """Return the one-sided spectrum of each row, zero-padded to a length."""
    return cast(NDArray[np.complex128], scipy.fft.rfft(samples, length, axis=-1))


def backward(spectrum: NDArray[np.complex128], length: int) -> NDArray[np.float64]:
    """Return real rows from their one-sided spectra: the inverse of `forward`."""
    return cast(NDArray[np.float64], scipy.fft.irfft(spectrum, length, axis=-1))


def fast_length(least: int) -> int:
    """Return the shortest even length from `least` upward that transforms fast."""
    return 2 * cast(int, scipy.fft.next_fast_len((least + 1) // 2, real=True))
