"""Repair of a subscription's streams: queries their extent, fetches missing messages, marks stored ones."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, Generic

import structlog

from duralab_bus.encoding import MessageT
from duralab_bus.faults import BusError, FaultError
from duralab_bus.streams.item import Received, RefusedItem, StreamItem
from duralab_bus.streams.order import StreamOrder, StreamProof
from duralab_bus.streams.replay import MOST_REPLAYED, Head, ReplayClient
from duralab_bus.threads import BusThread

FOLLOWED_STREAMS: Final = 256
"""Number of epochs that are remembered: every playback has one, and a lab runs for months."""

POLL_SECONDS: Final = 0.5
"""Interval in seconds at which publishers are asked for their extent: the end of a stream shows no gap."""

GAP_POLL_SECONDS: Final = 0.1
"""The same interval while messages are missing."""

HEARD_SECONDS: Final = 2.0
"""Time in seconds: a publisher that did not answer for longer is not asked for missing messages at every poll."""

PATIENCE_POLLS: Final = 20
"""Number of polls, 2 s, after which messages held back behind a gap are delivered if no publisher has the missing ones.
Polls, not seconds: a receiver that was frozen has not polled meanwhile."""

STUCK_POLLS: Final = 100
"""The same number if a publisher reports to have the missing messages, but requests return none."""

MOST_REPORTED: Final = 1000
"""Number of remembered refused messages of each stream, so that each is reported once; further ones twice."""

Stream = tuple[str, int]
"""Key and epoch."""


class _Followed(Generic[MessageT]):
    """One epoch of a stream, and when its publisher last answered."""

    def __init__(self) -> None:
        self.order = StreamOrder[StreamItem[MessageT]]()
        self.heard = -math.inf
        self.fruitless = 0
        self.progress = self.order.progress
        self.cursor = 0
        self.replayed = 0
        self.reported: set[int] = set()


class StreamRepair(Generic[MessageT]):
    """Follower of all streams of one subscription; queries on its own thread. Safe for threads.

    `deliver` is called with fetched messages, or with none if held-back messages may continue; it calls `take`, and one
    of the owner's callbacks for each message that `take` returns, regardless of how long that takes.
    """

    def __init__(
        self,
        client: ReplayClient,
        key_expression: str,
        message_type: type[MessageT],
        *,
        deliver: Callable[[Sequence[Received[MessageT]]], None],
    ) -> None:
        self._client = client
        self._expression = key_expression
        self._type = message_type
        self._deliver = deliver
        self._lock = threading.Lock()
        self._streams: dict[Stream, _Followed[MessageT]] = {}
        self._latest: _Followed[MessageT] | None = None
        self._freed: list[_Followed[MessageT]] = []
        self._wake = threading.Event()
        self.fetched = 0
        """Number of messages fetched from a publisher's spool."""
        self._lost_by_forgotten = 0
        self._marks = False
        self._closed = False
        self._log = structlog.get_logger("duralab_bus").bind(key=key_expression)
        BusThread(self._run, name="duralab_bus-repair").start()

    def take(self, items: Sequence[Received[MessageT]], *, replayed: bool) -> list[Received[MessageT]]:
        """Accept messages that arrived or were replayed; return those to deliver, or to report as refused, now."""
        ready: list[Received[MessageT]] = []
        with self._lock:
            freed, self._freed = self._freed, []
            for followed in freed:
                ready += followed.order.advance()
            for item in items:
                followed = self._follow((item.key, item.epoch))
                if isinstance(item, RefusedItem):
                    ready += self._refused(followed, item, replayed=replayed)
                else:
                    ready += followed.order.accept(item.seq, item)
                if followed.order.blocked:
                    self._wake.set()
        return ready

    def _refused(self, followed: _Followed[MessageT], item: RefusedItem, *, replayed: bool) -> list[Received[MessageT]]:
        if replayed:
            new, behind = followed.order.refuse(item.seq)
            return [item, *behind] if new and item.seq not in followed.reported else list(behind)
        # Damaged in transit, or from another publisher: the publisher may have it intact, and is asked.
        self._wake.set()
        known = item.seq in followed.reported
        if len(followed.reported) < MOST_REPORTED:
            followed.reported.add(item.seq)
        return [] if known else [item]

    def release(self) -> list[StreamItem[MessageT]]:
        """Return all messages that are held back, when no more will arrive."""
        with self._lock:
            return [each for followed in self._streams.values() for each in self._drained(followed)]

    @staticmethod
    def _drained(followed: _Followed[MessageT]) -> Iterator[StreamItem[MessageT]]:
        while followed.order.blocked:
            followed.order.skip()
            yield from followed.order.advance()

    def mark(self, positions: Iterable[tuple[str, int, int]]) -> None:
        """Note which messages are stored and notify the publishers; see `Subscription.mark`."""
        moved: dict[Stream, int] = {}
        with self._lock:
            self._marks = True
            for key, epoch, seq in positions:
                followed = self._streams.get((key, epoch))
                if followed is not None:
                    followed.order.store(seq)
                    moved[key, epoch] = 0
            for stream in moved:
                moved[stream] = self._streams[stream].order.mark
        self._send_marks(moved)

    def expect(self, key: str, epoch: int, count: int) -> None:
        """Note the number of messages; see `Subscription.expect`."""
        with self._lock:
            self._follow((key, epoch)).order.expect(count)
        self._wake.set()

    def proof(self, key: str, epoch: int) -> StreamProof:
        """Return the known state of an epoch; see `Subscription.proof`."""
        with self._lock:
            followed = self._streams.get((key, epoch))
            return StreamOrder[object]().proof() if followed is None else followed.order.proof()

    @property
    def lost(self) -> int:
        """Number of messages that no publisher has any more or that were refused, of all streams ever followed."""
        with self._lock:
            return self._lost_by_forgotten + sum(followed.order.lost for followed in self._streams.values())

    @property
    def missing(self) -> int:
        """Number of messages that are known to be published, but neither received nor lost."""
        with self._lock:
            return sum(followed.order.missing for followed in self._streams.values())

    def close(self) -> None:
        """Stop querying."""
        self._closed = True
        self._wake.set()

    def _follow(self, stream: Stream) -> _Followed[MessageT]:
        if (known := self._streams.get(stream)) is not None and known is self._latest:
            return known
        followed = self._streams.pop(stream, None) or _Followed[MessageT]()
        self._latest = followed
        # Moved to the end: the stream that was silent for longest is forgotten first; before it, streams of which no
        # publisher ever reported anything.
        self._streams[stream] = followed
        if len(self._streams) > FOLLOWED_STREAMS:
            strangers = (known for known, other in self._streams.items() if math.isinf(other.heard) and known != stream)
            forgotten = self._streams.pop(next(strangers, next(iter(self._streams))))
            self._lost_by_forgotten += forgotten.order.lost
        return followed

    def _run(self) -> None:
        while not self._closed:
            try:
                self._client.ask_heads(self._expression, self._on_head)
                # Answers from live publishers arrive within milliseconds; late ones count at the next poll.
                busy = self._rest(GAP_POLL_SECONDS)
                self._fetch()
                if not busy:
                    self._wake.wait(POLL_SECONDS - GAP_POLL_SECONDS)
                self._wake.clear()
            except BusError:
                return
            except Exception:  # noqa: BLE001 - the next poll may work
                self._log.exception("Streams could not be repaired.")

    def _rest(self, seconds: float) -> bool:
        time.sleep(seconds)
        with self._lock:
            return any(
                followed.order.gap and followed.fruitless <= PATIENCE_POLLS for followed in self._streams.values()
            )

    def _on_head(self, answer: Head) -> None:
        """Note the extent of a stream; on Zenoh's thread."""
        key, head = answer
        with self._lock:
            followed = self._follow((key, head.epoch))
            now = time.monotonic()
            if now - followed.heard > HEARD_SECONDS:
                followed.fruitless = 0
            followed.heard = now
            if followed.order.learn(first=head.first, next=head.next, marked=head.marked, done=head.done):
                self._freed.append(followed)
            # The publisher did not receive the last mark, was restarted, or has a message that was refused.
            behind = self._marks and head.marked < followed.order.mark
            mark = followed.order.mark
        if behind:
            self._send_marks({(key, head.epoch): mark})

    def _send_marks(self, marks: dict[Stream, int]) -> None:
        try:
            for (key, epoch), stored in marks.items():
                self._client.mark(key, epoch=epoch, stored=stored)
        except BusError:
            return  # Unmarked messages stay in their spool.

    def _fetch(self) -> None:
        """Request the missing messages of each stream, as long as some are returned."""
        with self._lock:
            streams = list(self._streams.items())
            go_on = bool(self._freed)
        if go_on:
            self._deliver([])
        for (key, epoch), followed in streams:
            while not self._closed and self._fetch_part(key, epoch, followed):
                pass

    def _fetch_part(self, key: str, epoch: int, followed: _Followed[MessageT]) -> bool:
        """Request missing messages of a stream once; return whether there may be more."""
        with self._lock:
            order = followed.order
            wanted = order.wanted(MOST_REPLAYED, start=followed.cursor)
            if order.progress != followed.progress:
                followed.progress, followed.fruitless = order.progress, 0
        if not wanted:
            # Fetched messages may not have reached the delivering thread yet: missing ones are requested next time.
            followed.cursor = 0
            replayed, followed.replayed = followed.replayed, 0
            if replayed:
                self._log.info("Messages were replayed.", stream=key, epoch=epoch, replayed=replayed)
            return False
        known = time.monotonic() - followed.heard < HEARD_SECONDS
        patience = STUCK_POLLS if known else PATIENCE_POLLS
        if followed.fruitless > patience and not known:
            return False  # No request until a publisher reports to have the messages.
        found = self._ask(key, epoch, wanted)
        if found:
            self._deliver(found)
            fetched = sum(isinstance(item, StreamItem) for item in found)
            followed.replayed += fetched
            self.fetched += fetched
            followed.cursor = found[-1].seq + 1
            return True
        followed.cursor = wanted.stop
        followed.fruitless += 1
        if followed.fruitless >= patience and order.blocked:
            self._log.warning("Nobody has what is missing.", stream=key, epoch=epoch, missing=len(wanted))
            with self._lock:
                order.skip()
                self._freed.append(followed)
            self._deliver([])
        return False

    def _ask(self, key: str, epoch: int, wanted: range) -> list[Received[MessageT]]:
        try:
            return self._client.ask(key, self._type, epoch=epoch, wanted=wanted)
        except FaultError as fault:
            self._log.warning("A replay is refused.", stream=key, epoch=epoch, reason=fault.message)
            return []
