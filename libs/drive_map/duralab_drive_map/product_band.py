"""Products of drives at a rate that holds their doubled bandwidth, and the return to the drives' rate."""

from __future__ import annotations

import math
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from duralab_spectra import band_mask

LARGEST_BAND_SHARE: Final = 0.45
"""Largest upper end of a band over the sample rate; the fade above it ends below half the sample rate."""
# Width of the fade above the band, as a share of its upper end.
_FADE_SHARE: Final = 0.1
# Zeros after a record, in periods of the fade: its ringing has decayed by then.
_PADDING_PERIODS: Final = 16.0


class ProductBand:
    """Transforms of records of one length for products up to a frequency.

    `samples`: Length of the records. `sample_rate`: Sample rate of the records, Hz. `highest`: Hz, at most
    `LARGEST_BAND_SHARE` of the sample rate; the gain is 1 up to it and fades to 0 above.
    """

    def __init__(self, samples: int, *, sample_rate: float, highest: float) -> None:
        fade = _FADE_SHARE * highest
        end = highest + fade
        length = 2 * cast(int, fft.next_fast_len(math.ceil((samples + _PADDING_PERIODS * sample_rate / fade) / 2)))
        count = math.ceil(end * length / sample_rate) + 1
        self._samples, self._length, self._count = samples, length, count
        # A product of lines below `count` has lines below `2 count`; none of them folds back at this length.
        self._short = 2 * cast(int, fft.next_fast_len(2 * count))
        self.rate: float = sample_rate * self._short / length
        """float: Rate of the products, Hz."""
        self.frequency: NDArray[np.float64] = np.arange(count, dtype=np.float64) * (sample_rate / length)
        """ndarray, shape (lines,): Frequency in Hz, from 0 to the end of the fade."""
        self.mask: NDArray[np.float64] = band_mask(self.frequency, 0.0, end, edge=fade)
        """ndarray, shape (lines,): 1 up to the highest frequency, 0 at the end of the fade."""

    @property
    def short_samples(self) -> int:
        """Number of samples of a record at the products' rate, without the zeros after it."""
        return math.floor(self._samples * self._short / self._length)

    def lowered(self, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return one channel in the band at the products' rate, with the zeros after it."""
        lines = cast(NDArray[np.complex128], fft.rfft(row, self._length))[: self._count]
        return cast(NDArray[np.float64], fft.irfft(lines * self.mask, self._short)) * (self._short / self._length)

    def lines(self, short: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the lines of a product at the products' rate, shape (lines,)."""
        return cast(NDArray[np.complex128], fft.rfft(short))[: self._count] * (self._length / self._short)

    def samples(self, lines: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the record with these lines, at the drives' rate, shape (samples,)."""
        return cast(NDArray[np.float64], fft.irfft(lines * self.mask, self._length))[: self._samples]
