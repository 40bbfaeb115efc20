"""LabClient publishers for what they keep: replays of what is missing, heads of what there is."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final

import zenoh

from duralab_bus.encoding import MessageT, decode, encoding_of
from duralab_bus.faults import BusError, FaultError
from duralab_bus.session import BusSession
from duralab_bus.streams.item import Received, StreamItem, read_item
from duralab_bus.streams.replay import head_key, mark_key, replay_key
from duralab_proto.v1 import stream_pb2

_TIMEOUT_SECONDS: Final = 2.0
_LARGEST_HEAD: Final = 128
# Below the streams: neither a long replay nor an asker that is frozen in the middle of one holds them up.
_PRIORITY: Final = zenoh.Priority.DATA_LOW

Head = tuple[str, stream_pb2.StreamHead]
"""The stream's key, and how far it reaches."""


class ReplayClient:
    """Client that requests kept messages from publishers.

    `session`: Session on which it asks. `largest_bytes`: Largest message that is accepted, in bytes.
    """

    def __init__(self, session: BusSession, *, largest_bytes: int) -> None:
        self._session = session
        self._largest_bytes = largest_bytes

    def ask(self, key: str, message_type: type[MessageT], *, epoch: int, wanted: range) -> list[Received[MessageT]]:
        """Ask once; return what came of it, at most 1000 messages, ascending."""
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
                # Said for the replies as well, which follow the query.
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
            # Zenoh ends the query after the timeout by itself; twice as long only where its session is stuck.
            while (reply := replies.get(timeout=2 * _TIMEOUT_SECONDS)) is not None:
                if reply.ok is None:
                    continue
                item = read_item(reply.ok, key=key, message_type=message_type, largest_bytes=self._largest_bytes)
                if item.epoch != epoch or item.seq not in wanted:
                    continue
                # Where more than one answers, what can be read counts.
                if isinstance(item, StreamItem) or item.seq not in items:
                    items[item.seq] = item
        except Empty:
            pass
        finally:
            stop.cancel()
        return [items[seq] for seq in sorted(items)]

    def ask_heads(self, key_expression: str, take: Callable[[Head], None]) -> zenoh.CancellationToken:
        """Ask how far the streams reach; each answer is handed over as it comes, on Zenoh's thread.

        Returns: Ends the question, which otherwise ends by itself after 2 s.
        """

        def on_reply(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is None:
                return
            try:
                head = decode(sample.payload, sample.encoding, stream_pb2.StreamHead, largest_bytes=_LARGEST_HEAD)
            except FaultError:
                return  # Of a stranger: it says nothing about its stream then.
            take((str(sample.key_expr).rpartition("/")[0], head))

        stop = zenoh.CancellationToken()
        try:
            self._session.current.get(
                head_key(key_expression),
                zenoh.handlers.Callback(on_reply, indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                # An answer that is lost is asked for again: nobody waits for a link because of it.
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=_TIMEOUT_SECONDS,
                cancellation_token=stop,
            )
        except zenoh.ZError as error:
            self._expect_open(f"{key_expression} cannot be asked", error)
        return stop

    def mark(self, key: str, *, epoch: int, stored: int) -> None:
        """Tell the publisher that all below a number are stored."""
        mark = stream_pb2.StreamMark(epoch=epoch, next=stored)
        try:
            self._session.current.put(
                mark_key(key),
                mark.SerializeToString(),
                encoding=encoding_of(mark),
                # A mark that is lost is followed by another.
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
            )
        except zenoh.ZError as error:
            self._expect_open(f"{key} cannot be marked", error)

    def _expect_open(self, what: str, error: zenoh.ZError) -> None:
        """Pass over what the session of a router that is away cannot send: it is asked for again."""
        if self._session.closed:
            raise BusError(f"{what}: this bus is closed ({error}).") from error
