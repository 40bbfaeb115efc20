"""Reception of streams: as they arrive, or complete and in order."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Final, Generic

import structlog
import zenoh

from duralab_bus.encoding import MessageT
from duralab_bus.faults import FaultError
from duralab_bus.session import BusSession
from duralab_bus.streams.item import Received, RefusedItem, StreamItem, read_item
from duralab_bus.streams.order import StreamProof
from duralab_bus.streams.repair import StreamRepair
from duralab_bus.streams.replay import ReplayClient
from duralab_bus.threads import BusThread

MOST_WAITING: Final = 8192
"""Number of messages that wait for the callback, in Zenoh's own memory: its threads never wait for Python's lock.
Beyond that the oldest are dropped, and with repair fetched again."""

_JOIN_SECONDS: Final = 2.0
_MOST_AT_ONCE: Final = 63


class Subscription(Generic[MessageT]):
    """Subscription to the messages of a key expression; made by `Bus.subscribe`, ended by `close`."""

    def __init__(
        self,
        session: BusSession,
        key_expression: str,
        message_type: type[MessageT],
        callback: Callable[[StreamItem[MessageT]], None],
        *,
        on_problem: Callable[[FaultError], None] | None,
        largest_bytes: int,
        client: ReplayClient | None,
        on_close: Callable[[Subscription[MessageT]], None],
    ) -> None:
        self.message: str = message_type.DESCRIPTOR.name
        """Name of the message type."""
        self.received = 0
        """Number of messages passed to the callback."""
        self._type = message_type
        self._callback = callback
        self._on_problem = on_problem or self._log_problem
        self._largest_bytes = largest_bytes
        self._on_close = on_close
        self._closed = False
        self._log = structlog.get_logger("duralab_bus").bind(key=key_expression)
        # One message after the other, on any thread. The callback itself may call `close`.
        self._delivering = threading.RLock()
        self._rest: list[zenoh.Sample] = []
        self._repair: StreamRepair[MessageT] | None = None
        if client is not None:
            self._repair = StreamRepair(
                client, key_expression, message_type, deliver=partial(self._deliver, replayed=True)
            )
        self._inbox = session.receive(
            lambda joined: joined.declare_subscriber(key_expression, zenoh.handlers.RingChannel(MOST_WAITING))
        )
        # A daemon: a stuck callback must not keep the process from ending.
        self._thread = BusThread(self._run, name=f"duralab_bus-{message_type.DESCRIPTOR.name}")
        self._thread.start()

    def mark(self, positions: Iterable[tuple[str, int, int]]) -> None:
        """Acknowledge messages that are stored, or never will be: publishers need not keep them any longer.

        Only for the one receiver that stores a stream. It must then mark every message that it received, by
        `StreamItem.position` in any order: publishers wait for it. Refused and lost messages are marked with the rest.
        A call without positions declares this receiver as the one that stores.
        """
        self._repaired.mark(positions)

    def expect(self, key: str, epoch: int, count: int) -> None:
        """Note the number of messages of an epoch, known from elsewhere, so that missing ones are fetched."""
        self._repaired.expect(key, epoch, count)

    def proof(self, key: str, epoch: int) -> StreamProof:
        """Return the state of an epoch of a stream: whether every message of it was delivered."""
        return self._repaired.proof(key, epoch)

    @property
    def fetched(self) -> int:
        """Number of messages that were lost in transit and fetched from their publisher's spool."""
        return 0 if self._repair is None else self._repair.fetched

    @property
    def lost(self) -> int:
        """Number of messages that are lost on the bus, or that were received and refused."""
        return 0 if self._repair is None else self._repair.lost

    @property
    def missing(self) -> int:
        """Number of messages that are known to be published, but neither received nor lost."""
        return 0 if self._repair is None else self._repair.missing

    def close(self) -> None:
        """Stop receiving; messages received before are delivered first, also those held back behind a gap."""
        if self._closed:
            return
        if self._repair is not None:
            self._repair.close()
        # Do not wait for a stuck callback.
        free = self._delivering.acquire(timeout=_JOIN_SECONDS)
        try:
            self._closed = True
            waiting = list(iter(self._inbox.next_at_once, None)) if free else []
            self._inbox.undeclare()
        finally:
            if free:
                self._delivering.release()
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN_SECONDS if free else 0.0)
        if free:
            # The thread may have taken one more message.
            items = self._read_all([*waiting, *self._rest])
            items.sort(key=lambda item: item.position)
            self._deliver(items)
            self._deliver_held()
        self._on_close(self)

    @property
    def _repaired(self) -> StreamRepair[MessageT]:
        if self._repair is None:
            raise ValueError("This subscription takes messages as they come; subscribe with repair=True.")
        return self._repair

    def _run(self) -> None:
        while (sample := self._inbox.next()) is not None:
            with self._delivering:
                if self._closed:
                    self._rest.append(sample)
                    return
                # Waiting releases the interpreter's lock, which costs more than a message: only when none is left.
                more = itertools.islice(iter(self._inbox.next_at_once, None), _MOST_AT_ONCE)
                self._deliver(self._read_all([sample, *more]))

    def _deliver(self, items: Sequence[Received[MessageT]], *, replayed: bool = False) -> None:
        """Deliver the messages that these make deliverable."""
        with self._delivering:
            for item in items if self._repair is None else self._repair.take(items, replayed=replayed):
                self._call(item)

    def _deliver_held(self) -> None:
        if self._repair is not None:
            with self._delivering:
                for each in self._repair.release():
                    self._call(each)

    def _call(self, item: Received[MessageT]) -> None:
        if isinstance(item, RefusedItem):
            self._report(item.fault)
            return
        self.received += 1
        try:
            self._callback(item)
        except Exception:  # noqa: BLE001 - an exception of one callback must not keep later messages from it
            self._log.exception("A callback failed.", seq=item.seq)

    def _read_all(self, samples: Iterable[zenoh.Sample]) -> list[Received[MessageT]]:
        return [item for sample in samples if (item := self._read(sample)) is not None]

    def _read(self, sample: zenoh.Sample) -> Received[MessageT] | None:
        try:
            return read_item(
                sample, key=str(sample.key_expr), message_type=self._type, largest_bytes=self._largest_bytes
            )
        except FaultError as fault:
            self._report(fault)
            return None

    def _report(self, fault: FaultError) -> None:
        try:
            self._on_problem(fault)
        except Exception:  # noqa: BLE001 - the same applies to this callback
            self._log.exception("A callback failed.")

    @staticmethod
    def _log_problem(fault: FaultError) -> None:
        structlog.get_logger("duralab_bus").warning("A stream message was refused.", reason=fault.message)
