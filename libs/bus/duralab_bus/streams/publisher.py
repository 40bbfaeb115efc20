"""Publishing of a stream: messages with an epoch and a sequence number, kept for receivers that missed them."""

from __future__ import annotations

import threading
import time
from typing import Final

import zenoh
from google.protobuf.message import Message

from duralab_bus.encoding import encode, encoding_of, zenoh_encoding_of
from duralab_bus.faults import BusError
from duralab_bus.metrics import Counter
from duralab_bus.session import BusSession
from duralab_bus.spool import SPOOL_BYTES, Spool, SpoolSpace
from duralab_bus.streams.item import POSITION
from duralab_bus.streams.replay import ReplayServer

# Above the queries: an answer that waits for a receiver blocks its queue, and no stream may wait behind it.
_PRIORITY: Final = zenoh.Priority.INTERACTIVE_LOW

_epoch_lock = threading.Lock()
_last_epoch = 0


def _new_epoch() -> int:
    """Return a number that no earlier publisher had: nanoseconds of the clock, so that later ones are larger."""
    global _last_epoch  # noqa: PLW0603 - unique within the process even when the clock stands still
    with _epoch_lock:
        _last_epoch = max(_last_epoch + 1, time.time_ns())
        return _last_epoch


class StreamPublisher:
    """Publisher on one key; made by `Bus.publisher`. May be used from several threads.

    No receiver delays it: a message that a receiver's link has no room for is dropped there. It stays in the spool,
    from which receivers request it on `<key>/@replay`. If no receiver marks messages as stored, the oldest are dropped,
    and the spool outlives `close` by a minute, but no more than three publishers closed later. If a receiver does, all
    unmarked messages are kept: `shortage` states when to stop, and a full spool refuses.
    """

    def __init__(
        self,
        session: BusSession,
        key: str,
        *,
        replays: ReplayServer,
        spools: SpoolSpace,
        held: bool,
        largest_bytes: int,
        published: Counter,
    ) -> None:
        self.key = key
        self._published = published
        self.epoch = _new_epoch()
        self._largest_bytes = largest_bytes
        self._lock = threading.Lock()
        self._closed = False
        self._session = session
        self._publisher = session.declare(
            lambda joined: joined.declare_publisher(
                key,
                # Not BLOCK: one frozen receiver would stop its publisher, and the rig with it.
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.RELIABLE,
                priority=_PRIORITY,
            )
        )
        store = spools.store(key=key, epoch=self.epoch)
        # Streams without acknowledgements share the space with those that are acknowledged.
        self._spool = Spool(store, held=held, unheld_bytes=min(SPOOL_BYTES, spools.largest_bytes // 8))
        self._offer = replays.offer(key=key, epoch=self.epoch, spool=self._spool)

    @property
    def shortage(self) -> str:
        """Reason to stop publishing until more is marked as stored; empty while there is room.

        An eighth of the spool, or the rest of a segment on a full disk, is still free then: for messages that must be
        published nevertheless, such as the ramp down of a rig.
        """
        return self._spool.shortage

    @property
    def unmarked(self) -> int:
        """Number of messages that are not marked as stored.

        A publisher that could outrun its receiver waits while these are more than a few thousand: messages that a
        receiver has no room for must be replayed, which costs both more than waiting.
        """
        return self._spool.unmarked

    def put(self, message: Message) -> int:
        """Publish a message and return its sequence number, from 0; does not wait for receivers.

        A published message has not necessarily arrived. Raises `FaultError` INVALID_ARGUMENT when it is too large,
        `SpoolFullError` when it was not published because it could not be kept, and `BusError` if the publisher or its
        bus is closed.
        """
        payload = encode(message, largest_bytes=self._largest_bytes)
        # One lock around number and sending, so that the order on the wire is the order of the numbers.
        with self._lock:
            if self._closed:
                raise BusError(f"The publisher of {self.key} is closed.")
            # Kept first: every received message can be requested again, also from a process that was killed.
            seq = self._spool.append(payload, encoding_of(message))
            self._send(payload, encoding=zenoh_encoding_of(type(message)), seq=seq)
            self._published.add(message.DESCRIPTOR.name)
            return seq

    def _send(self, payload: bytes, *, encoding: zenoh.Encoding, seq: int) -> None:
        publisher = self._publisher.current
        if publisher is None:
            return
        try:
            publisher.put(payload, encoding=encoding, attachment=POSITION.pack(self.epoch, seq))
        except zenoh.ZError as error:
            # While the router is away no receiver gets the message: it is requested afterwards.
            if self._session.closed:
                raise BusError(f"The bus under the publisher of {self.key} is closed.") from error

    def close(self) -> None:
        """Stop publishing. Messages already put are still sent, and replayed for a limited time."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._publisher.undeclare()
        self._offer.retire()
