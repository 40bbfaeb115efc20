"""Assignment of the samples of a record that arrives in pieces to captures."""

from collections.abc import Iterator

from identifier.layout import Capture, Layout


class UsedStretches:
    """Follows a record piece by piece and returns the used samples of each piece.

    `layout`: Layout of the record.
    """

    def __init__(self, layout: Layout) -> None:
        self._stretches = [
            (capture, capture.start, capture.start + layout.samples_of(capture)) for capture in layout.captures
        ]
        self._samples = layout.samples
        self._position = 0

    @property
    def position(self) -> int:
        """Number of samples of the record that have passed."""
        return self._position

    def next_pieces(self, samples: int) -> Iterator[tuple[Capture, slice, bool]]:
        """Yield the used parts of the next samples."""
        first = self._position
        last = first + samples
        if last > self._samples:
            raise ValueError(
                f"The record has {last} samples or more, its layout {self._samples}; "
                "estimate from the record of the drive that was played."
            )
        self._position = last
        for capture, start, stop in self._stretches:
            if start < last and stop > first:
                yield capture, slice(max(start, first) - first, min(stop, last) - first), stop <= last
