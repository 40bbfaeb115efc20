"""Streams: messages with an epoch and a sequence number, so that a receiver can prove that none is missing."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final, Generic

import structlog
import zenoh
from google.protobuf.message import Message

from labbus._delivery import Delivery
from labbus._encoding import MessageT, encode, encoding_of
from labbus._faults import BusError, FaultError
from labbus._gap_repair import GapRepair, Replay
from labbus._replay import ReplayServer
from labbus._spool import Spool
from labbus._stream_item import POSITION, StreamItem, read_item

# Above the queries: an answer that waits for a receiver holds its queue, and nothing of a stream must wait behind it.
_PRIORITY: Final = zenoh.Priority.INTERACTIVE_LOW

_epoch_lock = threading.Lock()
_last_epoch = 0


def _new_epoch() -> int:
    """Return a number that no publisher had before: nanoseconds of the clock, so that later ones are larger."""
    global _last_epoch  # noqa: PLW0603 - unique within the process even when the clock stands still
    with _epoch_lock:
        _last_epoch = max(_last_epoch + 1, time.time_ns())
        return _last_epoch


class StreamPublisher:
    """Publishes on one key; made by `Bus.publisher`. May be used from several threads.

    No receiver holds it up: a message that a receiver's link has no room for is dropped there. It stays in the spool
    in memory, the latest `spool_bytes` of the stream, from where receivers ask for it on `<key>/@replay`. The spool
    outlives `close` by a minute, but no more than three publishers closed later; it does not outlive the process.
    """

    def __init__(
        self, session: zenoh.Session, key: str, *, replays: ReplayServer, spool_bytes: int, largest_bytes: int
    ) -> None:
        self.key = key
        self.epoch = _new_epoch()
        self._next_seq = 0
        self._largest_bytes = largest_bytes
        self._lock = threading.Lock()
        self._closed = False
        self._publisher = session.declare_publisher(
            key,
            # Not BLOCK: one receiver that is frozen would stop its publisher, and the rig with it.
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
            priority=_PRIORITY,
        )
        self._spool = Spool(spool_bytes)
        self._offer = replays.offer(key=key, epoch=self.epoch, spool=self._spool)

    def put(self, message: Message) -> int:
        """Publish a message; waits for no receiver.

        Returns
        -------
        int
            Its sequence number, from 0. That it was published does not prove that it arrived.

        Raises
        ------
        FaultError
            INVALID_ARGUMENT when it is too large.
        BusError
            The publisher or its bus is closed.
        """
        payload = encode(message, largest_bytes=self._largest_bytes)
        encoding = encoding_of(message)
        # One lock around number and sending, so that the order on the wire is the order of the numbers.
        with self._lock:
            if self._closed:
                raise BusError(f"The publisher of {self.key} is closed.")
            seq = self._next_seq
            try:
                self._publisher.put(payload, encoding=encoding, attachment=POSITION.pack(self.epoch, seq))
            except zenoh.ZError as error:
                raise BusError(f"The bus under the publisher of {self.key} is closed.") from error
            self._spool.append(payload, encoding)
            self._next_seq = seq + 1
            return seq

    def close(self) -> None:
        """Publish no more. What was put is still sent, and replayed for a while."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._publisher.undeclare()
        self._offer.retire()


class Subscription(Generic[MessageT]):
    """Receives what is published on a key expression; made by `Bus.subscribe`, ended by `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        key_expression: str,
        message_type: type[MessageT],
        callback: Callable[[StreamItem[MessageT]], None],
        *,
        on_problem: Callable[[FaultError], None] | None,
        largest_bytes: int,
        replay: Replay[MessageT] | None,
        on_close: Callable[[Subscription[MessageT]], None],
    ) -> None:
        self._type = message_type
        self._callback = callback
        self._on_problem = on_problem or self._log_problem
        self._largest_bytes = largest_bytes
        self._repair = None if replay is None else GapRepair(replay)
        self._on_close = on_close
        self._closed = False
        self._delivery = Delivery[zenoh.Sample](self._deliver, name=f"labbus-{message_type.DESCRIPTOR.name}")
        # Not the default handler: it keeps 256 messages and then stalls the session.
        self._subscriber = session.declare_subscriber(
            key_expression, zenoh.handlers.Callback(self._delivery.put, indirect=False)
        )

    def close(self) -> None:
        """Receive no more; what was received before is delivered first."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()
            self._delivery.close()
            self._on_close(self)

    def _deliver(self, sample: zenoh.Sample) -> None:
        try:
            item = read_item(
                sample, key=str(sample.key_expr), message_type=self._type, largest_bytes=self._largest_bytes
            )
        except FaultError as fault:
            self._on_problem(fault)
            return
        if self._repair is None:
            self._callback(item)
            return
        for each in self._repair.complete(item):
            self._callback(each)

    @staticmethod
    def _log_problem(fault: FaultError) -> None:
        structlog.get_logger("labbus").warning("A stream message was refused.", reason=fault.message)
