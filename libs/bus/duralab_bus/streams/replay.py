"""Service of spools: a publisher answers on `<key>/@replay` and `<key>/@head`, and receives marks on `<key>/@mark`.

A replay query has the key parameters `epoch`, `first` and `stop`: the publisher, and the sequence numbers from `first`
on and before `stop`. Each reply is one message with payload, encoding and attachment as published; at most 1000 a
query, the first existing ones. A publisher of another epoch, or one that has none of them any more, sends nothing. A
head query is answered with one StreamHead for each epoch that is kept.
"""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, Final

import structlog
import zenoh

from duralab_bus.encoding import MessageT, decode, encoding_of
from duralab_bus.faults import BusError, FaultError
from duralab_bus.session import BusSession, Declaration
from duralab_bus.spool import Spool
from duralab_bus.streams.item import POSITION, Received, StreamItem, read_item
from duralab_bus.threads import BusThread
from duralab_proto.keys import stream_family
from duralab_proto.v1 import query_pb2, stream_pb2


class DelayedExecutor:
    """Executor that runs each job after its delay, in the order of their times; the thread starts with the first job.

    Not on Zenoh's threads: a slow callback there blocks the session. An exception of a job is logged.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._jobs: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = itertools.count()
        self._thread: threading.Thread | None = None
        self._closed = False

    def put(self, seconds: float, job: Callable[[], None]) -> None:
        """Run a job after `seconds`; never blocks. No job that is put after `close` runs."""
        with self._changed:
            if self._closed:
                return
            heapq.heappush(self._jobs, (time.monotonic() + seconds, next(self._numbers), job))
            if self._thread is None:
                # A daemon: a stuck job must not keep the process from ending.
                self._thread = BusThread(self._run, name=self._name)
                self._thread.start()
            self._changed.notify()

    def close(self) -> None:
        """Run the jobs that are due, discard the others; wait for the thread, but not for a stuck job."""
        with self._changed:
            self._closed = True
            now = time.monotonic()
            self._jobs = sorted(job for job in self._jobs if job[0] <= now)
            self._changed.notify()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(_JOIN_SECONDS)

    def _run(self) -> None:
        while (job := self._next()) is not None:
            try:
                job()
            except Exception:  # noqa: BLE001 - an exception of one job must not keep the others from running
                structlog.get_logger("duralab_bus").exception("A job failed.", thread=self._name)

    def _next(self) -> Callable[[], None] | None:
        with self._changed:
            while True:
                wait = self._jobs[0][0] - time.monotonic() if self._jobs else None
                if wait is not None and wait <= 0.0:
                    return heapq.heappop(self._jobs)[2]
                if self._closed:
                    return None
                self._changed.wait(wait)


MOST_REPLAYED: Final = 1000
"""Largest number of messages in the answer to one query, so that no answer delays the others for long."""

KEPT_SPOOLS: Final = 4
KEPT_SECONDS: Final = 60.0
"""Time in seconds for which the unacknowledged spools of the last closed publishers are kept, because the tail of a
run is requested after it."""

LAST_HEAD_SECONDS: Final = 5.0
"""Time in seconds for which the final extent of a stream is still reported after its end, when all of it is marked."""

_JOIN_SECONDS: Final = 2.0
_LARGEST_SEQ: Final = 2**64
_LARGEST_MARK: Final = 64
# A recorder flushes to disk four times a second.
_LAST_MARKS_SECONDS: Final = 0.5


def replay_key(key: str) -> str:
    """Return the key for replay queries of a stream; no wildcard of a subscription matches it."""
    return f"{key}/@replay"


def head_key(key: str) -> str:
    """Return the key for queries of a stream's extent."""
    return f"{key}/@head"


def mark_key(key: str) -> str:
    """Return the key on which the stored extent of a stream is published."""
    return f"{key}/@mark"


class SpoolOffer:
    """Spool of one epoch as offered on the bus."""

    def __init__(self, server: ReplayServer, *, key: str, epoch: int, spool: Spool) -> None:
        self.spool = spool
        self.epoch = epoch
        self.done = False
        self._server = server
        self._key = key
        self._expression = zenoh.KeyExpr(key)

    def is_on(self, stream: zenoh.KeyExpr) -> bool:
        """Return whether a key or key expression matches the stream."""
        return stream.intersects(self._expression)

    def retire(self) -> None:
        """End the stream: offer it until all of it is marked, or for a limited time without acknowledgements."""
        self.done = True
        self._server.retire(self)

    def replay(self, query: zenoh.Query, *, first: int, stop: int) -> None:
        """Send the kept messages from number `first` on and before `stop`."""
        for spooled in self.spool.read(first, stop, most=MOST_REPLAYED):
            query.reply(
                replay_key(self._key),
                spooled.payload,
                encoding=spooled.encoding,
                attachment=POSITION.pack(self.epoch, spooled.seq),
            )

    def answer_head(self, query: zenoh.Query) -> None:
        """Answer with the extent of the stream."""
        # Before the extent: a stream that is done does not grow any more.
        done, extent = self.done, self.spool.extent
        head = stream_pb2.StreamHead(
            epoch=self.epoch, first=extent.first, next=extent.next, marked=extent.marked, done=done
        )
        query.reply(head_key(self._key), head.SerializeToString(), encoding=encoding_of(head))

    def take_mark(self, marked: int) -> None:
        """Accept a mark: all messages below a number are stored; on Zenoh's thread."""
        if marked > self.spool.extent.next:
            # A recorder does not store unpublished messages: this mark is not from one.
            structlog.get_logger("duralab_bus").warning("A mark is refused.", key=self._key, next=marked)
        else:
            self._server.do(lambda: self._mark(marked), bulk=False)

    def _mark(self, marked: int) -> None:
        self.spool.mark(marked)
        if self.done and self.spool.settled:
            self._server.settle(self)


def _answered(query: zenoh.Query, answer: Callable[[zenoh.Query], None]) -> None:
    try:
        # A query that is not dropped would let the client wait for more.
        with query:
            answer(query)
    except zenoh.ZError:
        structlog.get_logger("duralab_bus").info("A replay could not be sent; its asker or this session is gone.")


def _number(query: zenoh.Query, name: str) -> int:
    text = query.parameters.get(name) or ""
    if not (text.isascii() and text.isdigit()) or len(text) > len(str(_LARGEST_SEQ)) or int(text) > _LARGEST_SEQ:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            f"The key parameter {name} is {text[:40]!r}; ask with 'epoch=…;first=…;stop=…', each from 0 to 2^64.",
            field=name,
        )
    return int(text)


class ReplayServer:
    """Server of one session's spools: replays one after the other on one thread, heads and marks on another.

    It declares its keys once for a whole family of streams, such as all runs of a rig: Zenoh 1.10.2 never forgets a
    separate key that was declared, and every declaration gets slower (see `queries/client.py`).
    """

    def __init__(self, session: BusSession) -> None:
        self._session = session
        self._lock = threading.Lock()
        self._offers: set[SpoolOffer] = set()
        # Not the lock of the offers: callbacks on Zenoh's threads must not wait for a declaration.
        self._declaring = threading.Lock()
        self._families: dict[str, tuple[Declaration[Any], ...]] = {}
        self._retired: deque[SpoolOffer] = deque()
        self._bulk, self._small = DelayedExecutor("duralab_bus-replay"), DelayedExecutor("duralab_bus-heads")
        self._closed = False

    @property
    def unstored(self) -> int:
        """Number of messages that a receiver has not acknowledged as stored."""
        with self._lock:
            extents = [offer.spool.extent for offer in self._offers if offer.spool.held]
        return sum(extent.next - extent.marked for extent in extents)

    def offer(self, *, key: str, epoch: int, spool: Spool) -> SpoolOffer:
        """Offer a spool on the bus."""
        with self._lock:
            if self._closed:
                raise BusError(f"The bus is closed; nothing can be published on {key}.")
        offer = SpoolOffer(self, key=key, epoch=epoch, spool=spool)
        with self._lock:
            self._offers.add(offer)
        try:
            self._answer_for(stream_family(key))
        except zenoh.ZError as error:
            self.withdraw(offer)
            raise BusError(f"Nothing can be published on {key}: {error}.") from error
        return offer

    def _answer_for(self, family: str) -> None:
        with self._declaring:
            if family in self._families:
                return
            replays, heads = self._callback(self._replay, bulk=True), self._callback(self._answer_heads, bulk=False)
            marks = zenoh.handlers.Callback(self._take_mark, indirect=False)
            self._families[family] = (
                self._session.declare(lambda joined: joined.declare_queryable(replay_key(family), replays)),
                self._session.declare(lambda joined: joined.declare_queryable(head_key(family), heads)),
                self._session.declare(lambda joined: joined.declare_subscriber(mark_key(family), marks)),
            )

    def _callback(self, answer: Callable[[zenoh.Query], None], *, bulk: bool) -> zenoh.handlers.Callback[zenoh.Query]:
        def take(query: zenoh.Query) -> None:
            # On Zenoh's thread: nothing here may block.
            self.do(lambda: _answered(query, answer), bulk=bulk)

        return zenoh.handlers.Callback(take, indirect=False)

    def _replay(self, query: zenoh.Query) -> None:
        try:
            epoch, first, stop = (_number(query, name) for name in ("epoch", "first", "stop"))
        except FaultError as fault:
            message = fault.to_message()
            query.reply_err(message.SerializeToString(), encoding=encoding_of(message))
            return
        for offer in self._offered(query.key_expr):
            if offer.epoch == epoch:
                offer.replay(query, first=first, stop=stop)

    def _answer_heads(self, query: zenoh.Query) -> None:
        for offer in self._offered(query.key_expr):
            offer.answer_head(query)

    def _take_mark(self, sample: zenoh.Sample) -> None:
        try:
            mark = decode(sample.payload, sample.encoding, stream_pb2.StreamMark, largest_bytes=_LARGEST_MARK)
        except FaultError as fault:
            key = str(sample.key_expr).rpartition("/")[0]
            structlog.get_logger("duralab_bus").warning("A mark is refused.", key=key, reason=fault.message)
            return
        for offer in self._offered(sample.key_expr):
            if offer.epoch == mark.epoch:
                offer.take_mark(mark.next)

    def _offered(self, asked: zenoh.KeyExpr) -> list[SpoolOffer]:
        """Return the offers of the streams that a `@replay`, `@head` or `@mark` key matches."""
        stream = zenoh.KeyExpr(str(asked).rpartition("/")[0])
        with self._lock:
            return [offer for offer in self._offers if offer.is_on(stream)]

    def do(self, job: Callable[[], None], *, bulk: bool) -> None:
        """Run a job on a thread of this server; never blocks."""
        (self._bulk if bulk else self._small).put(0.0, job)

    def retire(self, offer: SpoolOffer) -> None:
        """Keep an offer until it is settled; without acknowledgements, as one of the last few."""
        if offer.spool.settled:
            self.settle(offer)
        if offer.spool.held:
            return
        with self._lock:
            self._retired.append(offer)
            surplus = self._retired.popleft() if len(self._retired) > KEPT_SPOOLS else None
        if surplus is not None:
            self._expire(surplus)
        self._small.put(KEPT_SECONDS, lambda: self._expire(offer))

    def settle(self, offer: SpoolOffer) -> None:
        """Release a spool that no receiver needs; queries for its end are still answered for a short time."""
        offer.spool.close(delete=True)
        self._small.put(LAST_HEAD_SECONDS, lambda: self.withdraw(offer))

    def close(self) -> None:
        """Withdraw all offers, after a short wait for the last marks; unmarked messages on disk stay there."""
        deadline = time.monotonic() + _LAST_MARKS_SECONDS
        while time.monotonic() < deadline and self._unsettled():
            time.sleep(0.01)
        with self._lock:
            self._closed = True
            offers = list(self._offers)
        for offer in offers:
            self.withdraw(offer)
        with self._declaring:
            for declared in (one for family in self._families.values() for one in family):
                declared.undeclare()
            self._families.clear()
        self._bulk.close()
        self._small.close()

    def _unsettled(self) -> bool:
        with self._lock:
            return any(offer.spool.held and not offer.spool.settled for offer in self._offers)

    def _expire(self, offer: SpoolOffer) -> None:
        # It may have been marked meanwhile: then it is kept until it is settled.
        if not offer.spool.held:
            self.withdraw(offer)

    def withdraw(self, offer: SpoolOffer) -> None:
        """Withdraw an offer, and release its spool."""
        with self._lock:
            if offer not in self._offers:
                return
            self._offers.remove(offer)
            if offer in self._retired:
                self._retired.remove(offer)
        offer.spool.close(delete=False)


_TIMEOUT_SECONDS: Final = 2.0
_LARGEST_HEAD: Final = 128
# Below the streams: neither a long replay nor a client that is frozen during one delays them.
_PRIORITY: Final = zenoh.Priority.DATA_LOW

Head = tuple[str, stream_pb2.StreamHead]
"""Key of a stream, and its extent."""


class ReplayClient:
    """Client that requests kept messages from publishers."""

    def __init__(self, session: BusSession, *, largest_bytes: int) -> None:
        self._session = session
        self._largest_bytes = largest_bytes

    def ask(self, key: str, message_type: type[MessageT], *, epoch: int, wanted: range) -> list[Received[MessageT]]:
        """Send one replay query; return the received messages, at most 1000, ascending."""
        replies: SimpleQueue[zenoh.Reply | None] = SimpleQueue()
        stop = zenoh.CancellationToken()
        try:
            self._session.current.get(
                f"{replay_key(key)}?epoch={epoch};first={wanted.start};stop={wanted.stop}",
                zenoh.handlers.Callback(replies.put, drop=lambda: replies.put(None), indirect=False),
                # Several publishers may be on one key; only that of the epoch answers.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                # Applies also to the replies, which follow the query.
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=_PRIORITY,
                timeout=_TIMEOUT_SECONDS,
                cancellation_token=stop,
            )
        except zenoh.ZError as error:
            self._expect_open(f"{key} cannot be replayed", error)
            return []
        items: dict[int, Received[MessageT]] = {}
        try:
            # Zenoh ends the query after the timeout; a wait of twice that time means a stuck session.
            while (reply := replies.get(timeout=2 * _TIMEOUT_SECONDS)) is not None:
                if reply.ok is None:
                    continue
                item = read_item(reply.ok, key=key, message_type=message_type, largest_bytes=self._largest_bytes)
                if item.epoch != epoch or item.seq not in wanted:
                    continue
                # If several publishers answer, a message that can be read replaces one that cannot.
                if isinstance(item, StreamItem) or item.seq not in items:
                    items[item.seq] = item
        except Empty:
            pass
        finally:
            stop.cancel()
        return [items[seq] for seq in sorted(items)]

    def ask_heads(self, key_expression: str, take: Callable[[Head], None]) -> zenoh.CancellationToken:
        """Query the extents of streams; `take` gets each answer on arrival, on Zenoh's thread, for 2 s at most."""

        def on_reply(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is None:
                return
            try:
                head = decode(sample.payload, sample.encoding, stream_pb2.StreamHead, largest_bytes=_LARGEST_HEAD)
            except FaultError:
                return  # Not from a publisher of this contract: ignored.
            take((str(sample.key_expr).rpartition("/")[0], head))

        stop = zenoh.CancellationToken()
        try:
            self._session.current.get(
                head_key(key_expression),
                zenoh.handlers.Callback(on_reply, indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                # A lost answer is requested again: no link may block for it.
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=_TIMEOUT_SECONDS,
                cancellation_token=stop,
            )
        except zenoh.ZError as error:
            self._expect_open(f"{key_expression} cannot be asked", error)
        return stop

    def mark(self, key: str, *, epoch: int, stored: int) -> None:
        """Notify the publisher that all messages below a number are stored."""
        mark = stream_pb2.StreamMark(epoch=epoch, next=stored)
        try:
            self._session.current.put(
                mark_key(key),
                mark.SerializeToString(),
                encoding=encoding_of(mark),
                # A lost mark is followed by another.
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
            )
        except zenoh.ZError as error:
            self._expect_open(f"{key} cannot be marked", error)

    def _expect_open(self, what: str, error: zenoh.ZError) -> None:
        """Raise BusError if this bus is closed; ignore the error of a router that is away: the request is repeated."""
        if self._session.closed:
            raise BusError(f"{what}: this bus is closed ({error}).") from error
