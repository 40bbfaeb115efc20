"""Replay: a publisher answers on `<key>/@replay` with what it published, for those who lost some of it.

A query carries the key parameters `epoch`, `first` and `stop`: which publisher, and which sequence numbers from `first`
on and before `stop`. Each reply is one message with payload, encoding and attachment as it was published; at most 1000
a query, the first ones there are. A publisher of another epoch, or one that has none of them any more, sends nothing.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from queue import Empty, SimpleQueue
from typing import Final

import structlog
import zenoh

from duralab_proto.v1 import query_pb2
from labbus._delivery import Delivery
from labbus._encoding import MessageT, encoding_of
from labbus._faults import BusError, FaultError
from labbus._spool import Spool
from labbus._stream_item import POSITION, StreamItem, read_item

MOST_REPLAYED: Final = 1000
"""Messages answered to one query, so that no answer keeps the others waiting for long."""

KEPT_SPOOLS: Final = 4
KEPT_SECONDS: Final = 60.0
"""The spools of the last publishers that were closed are kept for so long: the tail of a run is asked for after it."""

_TIMEOUT_SECONDS: Final = 2.0
_LARGEST_SEQ: Final = 2**64
# Below the streams: neither a long replay nor an asker that is frozen in the middle of one holds them up.
_PRIORITY: Final = zenoh.Priority.DATA_LOW


def replay_key(key: str) -> str:
    """Return where the replay of a stream is asked for; no wildcard of a subscription matches it."""
    return f"{key}/@replay"


class ReplayOffer:
    """The spool of one publisher as it is offered on the bus."""

    def __init__(self, server: ReplayServer, session: zenoh.Session, *, key: str, epoch: int, spool: Spool) -> None:
        self._server = server
        self._key = replay_key(key)
        self._epoch = epoch
        self._spool = spool
        self._queryable = session.declare_queryable(self._key, zenoh.handlers.Callback(self._take, indirect=False))

    def retire(self) -> None:
        """Nothing more will be published: offer it for a while, then no more."""
        self._server.retire(self)

    def withdraw(self) -> None:
        """Offer it no more."""
        self._queryable.undeclare()

    def _take(self, query: zenoh.Query) -> None:
        self._server.take(self, query)

    def answer(self, query: zenoh.Query) -> None:
        """Send what is asked for and is there."""
        try:
            epoch, first, stop = (_number(query, name) for name in ("epoch", "first", "stop"))
        except FaultError as fault:
            message = fault.to_message()
            query.reply_err(message.SerializeToString(), encoding=encoding_of(message))
            return
        if epoch != self._epoch:
            return
        for spooled in self._spool.read(first, stop, most=MOST_REPLAYED):
            query.reply(
                self._key,
                spooled.payload,
                encoding=spooled.encoding,
                attachment=POSITION.pack(epoch, spooled.seq),
            )


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
    """Answers the replay queries of one session, one after the other, on a thread of its own."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._lock = threading.Lock()
        self._offers: set[ReplayOffer] = set()
        self._retired: deque[ReplayOffer] = deque()
        self._answering: Delivery[tuple[ReplayOffer, zenoh.Query]] | None = None
        self._closed = False

    def offer(self, *, key: str, epoch: int, spool: Spool) -> ReplayOffer:
        """Offer a publisher's spool on the bus."""
        with self._lock:
            if self._closed:
                raise BusError(f"The bus is closed; nothing can be published on {key}.")
            if self._answering is None:
                self._answering = Delivery(self._answer, name="labbus-replay")
        try:
            offer = ReplayOffer(self, self._session, key=key, epoch=epoch, spool=spool)
        except zenoh.ZError as error:
            raise BusError(f"Nothing can be published on {key}: {error}.") from error
        with self._lock:
            self._offers.add(offer)
        return offer

    def take(self, offer: ReplayOffer, query: zenoh.Query) -> None:
        """Take a query over from Zenoh's thread: nothing here may block."""
        answering = self._answering
        if answering is not None:
            answering.put((offer, query))

    def retire(self, offer: ReplayOffer) -> None:
        """Keep an offer as one of the last few."""
        with self._lock:
            self._retired.append(offer)
            surplus = self._retired.popleft() if len(self._retired) > KEPT_SPOOLS else None
        if surplus is not None:
            self._withdraw(surplus)
        timer = threading.Timer(KEPT_SECONDS, self._withdraw, [offer])
        timer.daemon = True
        timer.start()

    def close(self) -> None:
        """Offer nothing more."""
        with self._lock:
            self._closed = True
            offers = list(self._offers)
        for offer in offers:
            self._withdraw(offer)
        if self._answering is not None:
            self._answering.close()

    def _withdraw(self, offer: ReplayOffer) -> None:
        with self._lock:
            if offer not in self._offers:
                return
            self._offers.remove(offer)
            if offer in self._retired:
                self._retired.remove(offer)
        offer.withdraw()

    @staticmethod
    def _answer(asked: tuple[ReplayOffer, zenoh.Query]) -> None:
        offer, query = asked
        try:
            # Leaving the query undropped would let the asker wait for more.
            with query:
                offer.answer(query)
        except zenoh.ZError:
            structlog.get_logger("labbus").info("A replay could not be sent; its asker or this session is gone.")


class ReplayClient:
    """Asks for replays over one session."""

    def __init__(self, session: zenoh.Session, *, largest_bytes: int) -> None:
        self._session = session
        self._largest_bytes = largest_bytes

    def replay(
        self, key: str, message_type: type[MessageT], *, epoch: int, ranges: Iterable[range]
    ) -> list[StreamItem[MessageT]]:
        """Ask for what is missing; see `Bus.replay`."""
        found: list[StreamItem[MessageT]] = []
        for wanted in ranges:
            first = wanted.start
            while first < wanted.stop:
                part = self._ask(key, message_type, epoch=epoch, wanted=range(first, wanted.stop))
                if not part:
                    break
                found.extend(part)
                first = part[-1].seq + 1
        return found

    def _ask(self, key: str, message_type: type[MessageT], *, epoch: int, wanted: range) -> list[StreamItem[MessageT]]:
        replies: SimpleQueue[zenoh.Reply | None] = SimpleQueue()
        stop = zenoh.CancellationToken()
        try:
            self._session.get(
                f"{replay_key(key)}?epoch={epoch};first={wanted.start};stop={wanted.stop}",
                zenoh.handlers.Callback(replies.put, drop=lambda: replies.put(None), indirect=False),
                # Several publishers may be on one key; only that of the epoch answers.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                # Said for the replies as well, which follow the query.
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=_PRIORITY,
                timeout=_TIMEOUT_SECONDS,
                cancellation_token=stop,
            )
        except zenoh.ZError as error:
            raise BusError(f"{key} cannot be replayed: this bus is closed ({error}).") from error
        items: dict[int, StreamItem[MessageT]] = {}
        try:
            # Zenoh ends the query after the timeout by itself; twice as long only where its session is stuck.
            while (reply := replies.get(timeout=2 * _TIMEOUT_SECONDS)) is not None:
                if reply.ok is not None:
                    item = read_item(reply.ok, key=key, message_type=message_type, largest_bytes=self._largest_bytes)
                    if item.epoch == epoch and item.seq in wanted:
                        items[item.seq] = item
        except Empty:
            pass
        finally:
            stop.cancel()
        return [items[seq] for seq in sorted(items)]
