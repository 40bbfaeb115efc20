"""Lines of a control band as samples at a lower rate than the record's: enough for the band, and faster."""

from __future__ import annotations

from math import ceil
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from iterator.band.banded_transform import BandedTransform


class LowerRate:
    """Sample rate that is enough for the lines of a band, and transforms between both.

    `transform`: Of records to the lines of the band. `oversampling`: Lower rate over twice the highest line, 1 or more;
    the rate is never above that of the records.
    """

    def __init__(self, transform: BandedTransform, *, oversampling: float) -> None:
        self._length, self._inside = transform.length, transform.inside
        enough = 2 * cast(int, fft.next_fast_len(ceil(oversampling * transform.inside.stop)))
        self.samples: Final = min(transform.length, enough)
        """Number of samples at the lower rate, with those after the record."""
        self.share: Final = self.samples / self._length
        """Lower rate over that of the record."""

    def in_time(self, lines: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return lines, shape (rows, lines), as samples at the lower rate."""
        whole = np.zeros((lines.shape[0], self.samples // 2 + 1), dtype=np.complex128)
        whole[:, self._inside] = self.share * lines
        return cast(NDArray[np.float64], fft.irfft(whole, self.samples, axis=1))

    def in_lines(self, samples: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return samples at the lower rate, shape (rows, samples), as lines."""
        whole = cast(NDArray[np.complex128], fft.rfft(samples, axis=1))
        return whole[:, self._inside] / self.share

    def record(self, record: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a record, also its content outside the band, at the lower rate."""
        whole = cast(NDArray[np.complex128], fft.rfft(record, self._length, axis=1))
        below = whole[:, : self.samples // 2 + 1]
        return self.share * cast(NDArray[np.float64], fft.irfft(below, self.samples, axis=1))

    def mask(self, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return a mask of samples at the lower rate; False after the record."""
        result = np.zeros(self.samples, dtype=np.bool_)
        result[(np.flatnonzero(where) * self.share).astype(np.intp)] = True
        return result
