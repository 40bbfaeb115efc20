"""Long segments of a record, transformed whole, for the regressions of the local methods."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.used_stretches import UsedStretches
from identifier.layout import Capture, Layout, Window


class Segments:
    """Cuts the used samples of a record that arrives in pieces into segments.

    A capture of periods, or a block of a burst, is a segment; an uninterrupted capture of noise is divided into
    segments of one length, close to the requested one, so that all of it is used.

    `layout`: Layout of the record. `channels`: Drives and responses together, 1 or more. `segment_blocks`: Number of
    blocks in a segment of noise, 1 or more.
    """

    def __init__(self, layout: Layout, *, channels: int, segment_blocks: int) -> None:
        self._layout = layout
        self._used = UsedStretches(layout)
        self._wanted = segment_blocks * layout.block_samples
        self._buffer = np.empty((channels, max(self.length_of(capture) for capture in layout.captures)))
        self._filled = 0

    def length_of(self, capture: Capture) -> int:
        """Return the number of samples of a segment of a capture."""
        samples = self._layout.samples_of(capture)
        if self._layout.window is Window.NONE:
            return samples if self._layout.periodic else self._layout.block_samples
        return samples // max(1, round(samples / self._wanted))

    def next_segments(self, record: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
        """Yield the segments that the next samples complete."""
        for capture, piece, ends in self._used.next_pieces(record.shape[1]):
            length = self.length_of(capture)
            samples = record[:, piece]
            start = 0
            while start < samples.shape[1]:
                count = min(length - self._filled, samples.shape[1] - start)
                self._buffer[:, self._filled : self._filled + count] = samples[:, start : start + count]
                self._filled += count
                start += count
                if self._filled == length:
                    self._filled = 0
                    yield self._buffer[:, :length]
            if ends:
                self._filled = 0
