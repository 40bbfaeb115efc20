"""Whether the samples of a playback's blocks follow each other: a block may be lost before it has a number."""

from __future__ import annotations


class SampleOrder:
    """Compares where each block begins with where the one before it ends, in whatever order they come.

    Memory grows with the number of gaps between the blocks, not with their number.
    """

    def __init__(self) -> None:
        # Sample at which the block of a number is to begin, and does: until the other of the two is known.
        self._expected: dict[int, int] = {0: 0}
        self._found: dict[int, int] = {}
        self._misfit: tuple[int, int, int] | None = None

    def take(self, number: int, *, first: int, count: int) -> None:
        """Take note of a block that was not taken before."""
        self._compare(number, self._expected.pop(number, None), first, keep=self._found)
        self._compare(number + 1, self._found.pop(number + 1, None), first + count, keep=self._expected)

    def _compare(self, number: int, known: int | None, sample: int, *, keep: dict[int, int]) -> None:
        if known is None:
            keep[number] = sample
        elif known != sample and self._misfit is None:
            begins, ends = (sample, known) if keep is self._found else (known, sample)
            self._misfit = (number, begins, ends)

    @property
    def finding(self) -> str:
        """The first two blocks that do not join, in words; empty where all do."""
        if self._misfit is None:
            return ""
        number, begins, ends = self._misfit
        if number == 0:
            return f"its first block begins at sample {begins}"
        return f"block {number} begins at sample {begins}, the one before it ends at {ends}"
