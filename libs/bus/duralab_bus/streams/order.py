"""Order of one stream: messages to deliver, messages held back behind a gap, and missing, lost and stored ones."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Final, Generic, TypeVar


class Continuity:
    """Tracker of the sequence numbers of one publisher on one key: one instance per (key, epoch).

    Numbers count from 0. Memory grows with the number of gaps, not with the length of the stream.
    """

    def __init__(self) -> None:
        self._gaps: list[range] = []
        self._next = 0

    @property
    def next_seq(self) -> int:
        """Largest received number plus one; 0 before the first."""
        return self._next

    @property
    def contiguous(self) -> int:
        """Number of messages from the start without a gap."""
        return self._gaps[0].start if self._gaps else self._next

    @property
    def received(self) -> int:
        """Number of different messages received."""
        # Not len(): a wrong number from another publisher may exceed its range.
        return self._next - sum(gap.stop - gap.start for gap in self._gaps)

    @property
    def gaps(self) -> int:
        """Number of gaps between the received messages."""
        return len(self._gaps)

    def __contains__(self, seq: int) -> bool:
        return 0 <= seq < self._next and self._gap_around(seq) is None

    def accept(self, seq: int) -> list[range]:
        """Note a message; return the missing numbers that it reveals: those that it jumped over.

        Empty for the next in order, for one that fills a gap, and for one that was received before.
        """
        if seq == self._next:
            # The usual case, thousands of times a second.
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
        """Note all messages of a range of any length."""
        if seqs.start >= self._next:
            # Behind all gaps: thousands of ranges in order do not search those before them.
            if seqs.start > self._next:
                self._gaps.append(range(self._next, seqs.start))
            self._next = seqs.stop
            return
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


MOST_HELD: Final = 2000
"""Number of messages held back behind a gap; later ones are requested again."""

MOST_LOST_RANGES: Final = 1000
"""Number of remembered ranges of lost messages: a stream in which every other message is refused may run for months."""

T = TypeVar("T")


@dataclass(frozen=True)
class StreamProof:
    """State of one epoch of a stream at a receiver."""

    received: int
    """Number of different messages delivered."""
    next: int
    """Number of published messages, as far as known."""
    done: bool
    """Whether the stream is complete: its publisher closed it, or the expected count was received."""
    missing: tuple[range, ...]
    """Messages published, and neither delivered nor lost: still requested."""
    lost: tuple[range, ...]
    """Messages dropped from their publisher's spool before they were received, or received and refused; the first 1000
    ranges."""

    @property
    def complete(self) -> bool:
        """Whether every published message is delivered."""
        return self.done and not self.missing and not self.lost


class StreamOrder(Generic[T]):
    """Order of the messages of one epoch. Not safe for threads."""

    def __init__(self) -> None:
        self._next = 0
        self._held: dict[int, T] = {}
        self._delivered = Continuity()
        self._stored = Continuity()
        self._lost: list[range] = []
        self.lost = 0
        """Number of messages that no publisher has any more, or that were refused."""
        self._count = 0
        self._done = False
        self._begin: int | None = None
        self._forgone = 0

    @property
    def blocked(self) -> bool:
        """Whether messages are held back behind a gap."""
        return bool(self._held)

    @property
    def gap(self) -> bool:
        """Whether a published message is known to be missing here."""
        return self._next < self._count

    @property
    def progress(self) -> tuple[int, bool]:
        """State that changes when a message is delivered, lost, or the first one held back; not with further ones."""
        return self._delivered.received, self.blocked

    @property
    def missing(self) -> int:
        """Number of messages known to be published that are not delivered, held back or lost."""
        return sum(gap.stop - gap.start for gap in self._delivered.missing(self._count)) - len(self._held)

    @property
    def mark(self) -> int:
        """Number below which all messages are stored or lost: they need not be kept for this receiver."""
        return self._stored.contiguous

    def accept(self, seq: int, item: T) -> list[T]:
        """Accept a message; return the messages that may be delivered now, in order.

        Empty for a duplicate and for a message behind a gap. A message that was skipped is delivered at once.
        """
        if seq == self._next == self._delivered.next_seq and not self._held:
            # The usual case, thousands of times a second.
            self._count = max(self._count, seq + 1)
            self._deliver(seq)
            return [item]
        if seq in self._delivered or seq in self._held:
            return []
        self._count = max(self._count, seq + 1)
        if seq > self._next:
            if len(self._held) < MOST_HELD:
                self._held[seq] = item
            return []
        if seq < self._next:
            self._delivered.accept(seq)
            return [item]
        self._deliver(seq)
        return [item, *self._release()]

    def refuse(self, seq: int) -> tuple[bool, list[T]]:
        """Note a message that cannot be read: it is lost, and the messages behind it do not wait for it."""
        if seq in self._delivered or seq in self._held:
            return not any(seq in gap for gap in self._lost), []
        self._count = max(self._count, seq + 1)
        if seq > self._next and len(self._held) + self._delivered.gaps >= MOST_HELD:
            return False, []
        self._delivered.accept(seq)
        self._forgone += 1
        # It will never be stored, so its publisher need not keep it for that.
        self._stored.accept(seq)
        self._lose(range(seq, seq + 1))
        return True, self._release()

    def learn(self, *, first: int, next: int, marked: int, done: bool) -> bool:
        """Note the publisher's report of its spool; return whether `advance` may now deliver messages."""
        # A message beyond the end that the publisher reports is not of this stream.
        self._count = next if done else max(self._count, next)
        self._done = self._done or done
        if self._begin is None:
            # Messages stored before this receiver existed are no loss; a receiver that has the first one existed then.
            self._begin = 0 if self._delivered.contiguous else marked
        gone = [part for gap in self._delivered.missing(first) for part in self._not_held(gap)]
        for gap in gone:
            self._delivered.fill(gap)
            self._forgone += gap.stop - gap.start
            self._stored.fill(gap)
            if lost := range(max(gap.start, self._begin), gap.stop):
                self._lose(lost)
        return bool(gone)

    def expect(self, count: int) -> None:
        """Note the final number of published messages."""
        self._count = max(self._count, count)
        self._done = True

    def skip(self) -> None:
        """Stop waiting for the first gap: as far as known, no publisher has the missing messages."""
        if self._held:
            self._next = min(self._held)

    def advance(self) -> list[T]:
        """Return the messages that may be delivered, after `learn` or `skip`."""
        return self._release()

    def wanted(self, most: int, *, start: int = 0) -> range:
        """Return the first missing numbers from `start` on, at most `most`; empty if none is missing."""
        for gap in self._delivered.missing(self._count):
            for part in self._not_held(range(max(gap.start, start), gap.stop)):
                return part[:most]
        return range(0)

    def store(self, seq: int) -> None:
        """Note that a message is stored."""
        self._stored.accept(seq)

    def proof(self) -> StreamProof:
        """Return the known state."""
        return StreamProof(
            received=self._delivered.received - self._forgone,
            next=self._count,
            done=self._done,
            missing=tuple(self._delivered.missing(self._count)),
            # A refused message beyond the end is not of this stream either.
            lost=tuple(
                range(gap.start, min(gap.stop, self._count))
                for gap in sorted(self._lost, key=lambda gap: gap.start)
                if gap.start < self._count
            ),
        )

    def _lose(self, gap: range) -> None:
        self.lost += gap.stop - gap.start
        if self._lost and self._lost[-1].stop == gap.start:
            self._lost[-1] = range(self._lost[-1].start, gap.stop)
        elif len(self._lost) < MOST_LOST_RANGES:
            self._lost.append(gap)

    def _deliver(self, seq: int) -> None:
        self._delivered.accept(seq)
        self._next = seq + 1

    def _not_held(self, gap: range) -> list[range]:
        """Return the parts of a gap that are not held back behind another one."""
        inside = sorted(seq for seq in self._held if seq in gap)
        edges = [gap.start, *(edge for seq in inside for edge in (seq, seq + 1)), gap.stop]
        parts = [range(edges[number], edges[number + 1]) for number in range(0, len(edges), 2)]
        return [part for part in parts if part]

    def _release(self) -> list[T]:
        released: list[T] = []
        while True:
            while self._next in self._held:
                released.append(self._held.pop(self._next))
                self._deliver(self._next)
            following = self._delivered.first_missing(self._next)
            if following == self._next:
                return released
            self._next = following
