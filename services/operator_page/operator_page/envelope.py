"""Thinning of signals for a screen: smallest and largest value of each bucket, so that no peak is lost."""

from __future__ import annotations

import numpy as np

MOST_BUCKETS = 1200
"""Largest number of buckets: more points than a screen has columns are not visible."""


class Envelope:
    """Smallest and largest values of a growing record, channels by buckets of equal length.

    When all buckets are used, pairs are merged: all data stays, at half the resolution.
    """

    def __init__(self, channels: int, *, samples: int = 0, buckets: int = MOST_BUCKETS) -> None:
        self._buckets = buckets
        self.bucket_samples = max(1, -(-samples // buckets))
        self.samples = 0
        self._low = np.full((channels, buckets), np.nan)
        self._high = np.full((channels, buckets), np.nan)

    @property
    def used(self) -> int:
        """Number of buckets with samples."""
        return -(-self.samples // self.bucket_samples)

    def put(self, first: int, block: np.ndarray) -> None:
        """Add samples, shape (channels, samples), from index `first` on; missing samples before them stay empty."""
        while first + block.shape[1] > self.bucket_samples * self._buckets:
            self._halve()
        index = np.arange(first, first + block.shape[1]) // self.bucket_samples
        starts = np.flatnonzero(np.r_[True, np.diff(index) > 0]) if index.size else np.zeros(0, dtype=int)
        if index.size:
            where = index[starts]
            self._low[:, where] = np.fmin(self._low[:, where], np.minimum.reduceat(block, starts, axis=1))
            self._high[:, where] = np.fmax(self._high[:, where], np.maximum.reduceat(block, starts, axis=1))
        self.samples = max(self.samples, first + block.shape[1])

    def part(self, first_bucket: int) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest values from a bucket on, each of shape (channels, buckets)."""
        return self._low[:, first_bucket : self.used], self._high[:, first_bucket : self.used]

    def _halve(self) -> None:
        for values, join in ((self._low, np.fmin), (self._high, np.fmax)):
            values[:, : self._buckets // 2] = join(values[:, 0::2], values[:, 1::2])
            values[:, self._buckets // 2 :] = np.nan
        self.bucket_samples *= 2


def rounded(values: np.ndarray) -> list[list[float | None]]:
    """Return numbers for a document: four digits, which is a tenth of a pixel; None for NaN."""
    return [[None if np.isnan(value) else float(f"{value:.4g}") for value in row] for row in values.tolist()]
