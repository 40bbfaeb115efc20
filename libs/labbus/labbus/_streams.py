"""Streams: messages with an epoch and a sequence number, so that a receiver can prove that none is missing."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic

import structlog
import zenoh
from google.protobuf.message import Message

from duralab_proto.v1 import query_pb2
from labbus._delivery import Delivery
from labbus._encoding import MessageT, decode, encode, encoding_of
from labbus._faults import BusError, FaultError

_POSITION: Final = struct.Struct("<QQ")
"""The attachment of every stream message: epoch and sequence number, unsigned 64 bit, little-endian."""

_epoch_lock = threading.Lock()
_last_epoch = 0


def _new_epoch() -> int:
    """Return a number that no publisher had before: nanoseconds of the clock, so that later ones are larger."""
    global _last_epoch  # noqa: PLW0603 - unique within the process even when the clock stands still
    with _epoch_lock:
        _last_epoch = max(_last_epoch + 1, time.time_ns())
        return _last_epoch


@dataclass(frozen=True)
class StreamItem(Generic[MessageT]):
    """One message of a stream."""

    key: str
    epoch: int
    """Of the publisher: a new one starts again at sequence number 0."""
    seq: int
    message: MessageT


class StreamPublisher:
    """Publishes on one key; made by `Bus.publisher`. May be used from several threads."""

    def __init__(self, session: zenoh.Session, key: str, *, largest_bytes: int) -> None:
        self.key = key
        self.epoch = _new_epoch()
        self._next_seq = 0
        self._largest_bytes = largest_bytes
        self._lock = threading.Lock()
        self._closed = False
        self._publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK, reliability=zenoh.Reliability.RELIABLE
        )

    def put(self, message: Message) -> int:
        """Publish a message; blocks while a receiver's link is full.

        Returns
        -------
        int
            Its sequence number, from 0. That it was sent does not prove that it arrived.

        Raises
        ------
        FaultError
            INVALID_ARGUMENT when it is too large.
        BusError
            The publisher or its bus is closed.
        """
        payload = encode(message, largest_bytes=self._largest_bytes)
        # One lock around number and sending, so that the order on the wire is the order of the numbers.
        with self._lock:
            if self._closed:
                raise BusError(f"The publisher of {self.key} is closed.")
            seq = self._next_seq
            try:
                self._publisher.put(payload, encoding=encoding_of(message), attachment=_POSITION.pack(self.epoch, seq))
            except zenoh.ZError as error:
                raise BusError(f"The bus under the publisher of {self.key} is closed.") from error
            self._next_seq = seq + 1
            return seq

    def close(self) -> None:
        """Publish no more. What was put is still sent."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._publisher.undeclare()


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
    ) -> None:
        self._type = message_type
        self._callback = callback
        self._on_problem = on_problem or self._log_problem
        self._largest_bytes = largest_bytes
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

    def _deliver(self, sample: zenoh.Sample) -> None:
        try:
            item = self._item(sample)
        except FaultError as fault:
            self._on_problem(fault)
            return
        self._callback(item)

    def _item(self, sample: zenoh.Sample) -> StreamItem[MessageT]:
        key = str(sample.key_expr)
        try:
            position = b"" if sample.attachment is None else sample.attachment.to_bytes()
            if len(position) != _POSITION.size:
                raise FaultError(
                    query_pb2.FAULT_CODE_DATA_LOSS,
                    f"The message has {len(position)} bytes of epoch and sequence number attached; expected are "
                    f"{_POSITION.size}.",
                )
            message = decode(sample.payload, sample.encoding, self._type, largest_bytes=self._largest_bytes)
        except FaultError as fault:
            raise FaultError(fault.code, f"On {key}: {fault.message}") from fault
        epoch, seq = _POSITION.unpack(position)
        return StreamItem(key=key, epoch=epoch, seq=seq, message=message)

    @staticmethod
    def _log_problem(fault: FaultError) -> None:
        structlog.get_logger("labbus").warning("A stream message was refused.", reason=fault.message)
