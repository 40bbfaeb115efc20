"""What is missing in a stream: a pure tracker of sequence numbers."""

from __future__ import annotations

from bisect import bisect_right


class Continuity:
    """Follows the sequence numbers of one publisher on one key: one instance per (key, epoch).

    Numbers count from 0. Memory grows with the number of gaps, not with the length of the stream.
    """

    def __init__(self) -> None:
        self._gaps: list[range] = []
        self._next = 0

    @property
    def next_seq(self) -> int:
        """One more than the largest number received; 0 before the first."""
        return self._next

    @property
    def contiguous(self) -> int:
        """How many messages from the start are there without a gap."""
        return self._gaps[0].start if self._gaps else self._next

    @property
    def received(self) -> int:
        """How many different messages were received."""
        # Not len(): a stranger's number may be beyond what it takes.
        return self._next - sum(gap.stop - gap.start for gap in self._gaps)

    @property
    def gaps(self) -> int:
        """How many gaps there are between those received."""
        return len(self._gaps)

    def __contains__(self, seq: int) -> bool:
        return 0 <= seq < self._next and self._gap_around(seq) is None

    def accept(self, seq: int) -> list[range]:
        """Take note of a message.

        Parameters
        ----------
        seq : int
            Its number, 0 or more; one that was received before changes nothing.

        Returns
        -------
        list of range
            The numbers found missing by this message: those it jumped over. Empty for the next in order, for one that
            fills a gap, and for a double.
        """
        if seq == self._next:
            # The rule, of which there are thousands a second.
            self._next = seq + 1
            return []
        if seq < 0:
            raise ValueError(f"The sequence number {seq} is negative; numbers count from 0.")
        if seq > self._next:
            jumped = range(self._next, seq)
            self._next = seq + 1
            self._gaps.append(jumped)
            return [jumped]
        position = self._gap_around(seq)
        if position is None:
            return []
        gap = self._gaps[position]
        parts = (range(gap.start, seq), range(seq + 1, gap.stop))
        self._gaps[position : position + 1] = [part for part in parts if part]
        return []

    def fill(self, seqs: range) -> None:
        """Take note of all messages of a range, however long it is."""
        if seqs.start > self._next:
            self._gaps.append(range(self._next, seqs.start))
        self._next = max(self._next, seqs.stop)
        left: list[range] = []
        for gap in self._gaps:
            if gap.stop <= seqs.start or gap.start >= seqs.stop:
                left.append(gap)
            else:
                left += [part for part in (range(gap.start, seqs.start), range(seqs.stop, gap.stop)) if part]
        self._gaps = left

    def first_missing(self, seq: int) -> int:
        """Return the first number from `seq` on that was not received."""
        if seq >= self._next or self._gap_around(seq) is not None:
            return seq
        following = bisect_right(self._gaps, seq, key=lambda gap: gap.start)
        return self._gaps[following].start if following < len(self._gaps) else self._next

    def missing(self, count: int) -> list[range]:
        """Return the numbers below `count` that were not received, as ascending ranges that do not touch."""
        found = [range(gap.start, min(gap.stop, count)) for gap in self._gaps if gap.start < count]
        if self._next < count:
            found.append(range(self._next, count))
        return found

    def _gap_around(self, seq: int) -> int | None:
        position = bisect_right(self._gaps, seq, key=lambda gap: gap.start) - 1
        return position if position >= 0 and seq in self._gaps[position] else None
