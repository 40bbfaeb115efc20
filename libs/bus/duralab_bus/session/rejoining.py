"""A Zenoh session that is replaced by another one after its router was away.

A router that was frozen finds the old, broken links of its clients and their new, waiting ones at the same time. Zenoh
1.10.2 then takes a client that returns under its old id for the one that it is about to drop: in a trace, two of three
were refused at first, and the third was attached to the transport that was being closed. A session that returns under
another id cannot be confused with an old one.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Generic, Protocol, TypeVar

import structlog
import zenoh

from duralab_bus.faults import BusError, FaultError
from duralab_bus.session.config import BusConfig, BusMode
from duralab_bus.session.session import open_session
from duralab_bus.threads import BusThread
from duralab_proto.v1 import query_pb2

# Zenoh itself tries again at once and after 50 ms (`session.py`): a running router has the link back by then.
_GRACE_SECONDS: Final = 0.2
_AGAIN_SECONDS: Final = 0.2
_CLOSE_SECONDS: Final = 1.0


class _Declared(Protocol):
    def undeclare(self) -> None: ...


class _Received(_Declared, Protocol):
    @property
    def handler(self) -> Any: ...


DeclaredT = TypeVar("DeclaredT", bound=_Declared)
ReceivedT = TypeVar("ReceivedT", bound=_Received)


class Declaration(Generic[DeclaredT]):
    """Declaration of a session and of its replacement; made by `BusSession.declare`."""

    def __init__(self, owner: BusSession, declare: Callable[[zenoh.Session], DeclaredT]) -> None:
        self._owner = owner
        self._declare = declare
        self.current: DeclaredT | None = None
        """Zenoh's declaration; None while the router has been away since it was made."""

    def renew(self, session: zenoh.Session) -> None:
        """Declare it on a session."""
        self.current = self._declare(session)

    def undeclare(self) -> None:
        """Withdraw the declaration."""
        self._owner.forget(self)
        if self.current is not None:
            # A closed session has already dropped it.
            with suppress(zenoh.ZError):
                self.current.undeclare()


class Inbox(Declaration[ReceivedT]):
    """Declaration that receives into a channel of Zenoh; made by `BusSession.receive`."""

    def __init__(self, owner: BusSession, declare: Callable[[zenoh.Session], ReceivedT]) -> None:
        super().__init__(owner, declare)
        self._channel: Any = None

    def renew(self, session: zenoh.Session) -> None:
        """Declare it on a session; items in the channel of the previous session are left there."""
        super().renew(session)
        self._channel = None if self.current is None else self.current.handler

    def next(self) -> Any | None:
        """Wait for the next item, over any number of sessions; None after the declaration is withdrawn."""
        while True:
            channel = self._channel
            if channel is not None:
                with suppress(zenoh.ZError):
                    return channel.recv()
            if not self._owner.wait_until(self, lambda channel=channel: self._channel is not channel):
                return None

    def next_at_once(self) -> Any | None:
        """Return the next item that has already arrived; None if there is no item."""
        if self._channel is None:
            return None
        # Called once for each message, and a `with` takes 0.6 µs.
        try:
            return self._channel.try_recv()
        except zenoh.ZError:
            return None


_AnyDeclaration = TypeVar("_AnyDeclaration", bound=Declaration[Any])


class BusSession:
    """Session of a bus: Zenoh's, and for a client its replacement after the router was away."""

    def __init__(self, session: zenoh.Session, config: BusConfig) -> None:
        self.current = session
        """Zenoh's session; closed while the router is away."""
        self.linked = time.monotonic()
        """Time when its link was made, in s of the monotonic clock: at the start, by a replacement, or by Zenoh."""
        self.lost = -math.inf
        """Time when a client last lost its link to the router, in s of the monotonic clock."""
        self._config = config
        self._changed = threading.Condition()
        self._declarations: dict[Declaration[Any], None] = {}
        self.away = False
        """Whether its router is away: new declarations are made when it is back, and nothing is sent."""
        self._closed = threading.Event()
        self._broken = threading.Event()
        self._log = structlog.get_logger("duralab_bus")
        if config.mode is BusMode.CLIENT:
            self._listener = self._listen()
            BusThread(self._run, name="duralab_bus-rejoining").start()

    @property
    def closed(self) -> bool:
        """Whether it was closed by its owner, and does not return."""
        return self._closed.is_set()

    @property
    def router(self) -> str:
        """Router of a client, as a sentence names it."""
        return f"the router at {', '.join(self._config.connect)}"

    def disturbed(self, since: float) -> bool:
        """Return whether a client has no link to the router, or lost or restored it after a given time."""
        return self.away or self.lost > self.linked or (self.lost > -math.inf and self.linked >= since)

    def expect_router(self, key: str, session: zenoh.Session | None = None) -> None:
        """Raise FaultError UNAVAILABLE while the router is away, or if it was away since `session` was current."""
        if not self.closed and (self.away or session not in (None, self.current)):
            raise FaultError(
                query_pb2.FAULT_CODE_UNAVAILABLE,
                f"T{self.router[1:]} is away or was just now, so nothing was sent on {key}; "
                "see that it runs, and ask again.",
            )

    def declare(self, declare: Callable[[zenoh.Session], DeclaredT]) -> Declaration[DeclaredT]:
        """Declare something on this session and on each one that replaces it."""
        return self._declared(Declaration(self, declare))

    def receive(self, declare: Callable[[zenoh.Session], ReceivedT]) -> Inbox[ReceivedT]:
        """Declare something with a channel, like `declare`."""
        return self._declared(Inbox(self, declare))

    def _declared(self, declaration: _AnyDeclaration) -> _AnyDeclaration:
        with self._changed:
            if not self.away:
                declaration.renew(self.current)
            self._declarations[declaration] = None
        return declaration

    def forget(self, declaration: Declaration[Any]) -> None:
        """Remove a declaration: it is not made on a session that replaces this one."""
        with self._changed:
            self._declarations.pop(declaration, None)
            self._changed.notify_all()

    def wait_until(self, declaration: Declaration[Any], changed: Callable[[], bool]) -> bool:
        """Wait for a change; return False after the declaration is forgotten or the session closed."""
        with self._changed:
            self._changed.wait_for(lambda: changed() or declaration not in self._declarations or self.closed)
            return changed()

    def close(self) -> None:
        """Leave the bus."""
        with self._changed:
            self._closed.set()
            self._changed.notify_all()
        self._broken.set()
        self._close_current()

    def _close_current(self) -> None:
        # Closing waits for Zenoh's own threads; a stuck link must not block the others.
        closing = BusThread(self.current.close, name="duralab_bus-close")
        closing.start()
        closing.join(_CLOSE_SECONDS)

    def _listen(self) -> zenoh.TransportEventsListener[None]:
        session = self.current

        def note(event: zenoh.TransportEvent) -> None:
            if event.kind == zenoh.SampleKind.DELETE:
                if session is self.current:
                    self.lost = time.monotonic()
                self._broken.set()
            elif session is self.current:
                self.linked = time.monotonic()

        return session.info.declare_transport_events_listener(zenoh.handlers.Callback(note, indirect=False))

    def _run(self) -> None:
        while True:
            self._broken.wait()
            if self._closed.wait(_GRACE_SECONDS):
                return
            self._broken.clear()
            if not self.current.info.transports():
                self._rejoin()

    def _rejoin(self) -> None:
        self._log.warning("The router is away.", endpoints=list(self._config.connect))
        with self._changed:
            self.away = True
        # First, so that the old session does not return as well.
        self._close_current()
        session = self._opened_again()
        if session is None:
            return
        with self._changed:
            self.current, self.linked, self.away = session, time.monotonic(), False
            self._listener = self._listen()
            for declaration in self._declarations:
                self._renew(declaration)
            self._changed.notify_all()
        if self.closed:
            self._close_current()
            return
        self._log.warning("The router is back.", declarations=len(self._declarations))

    def _opened_again(self) -> zenoh.Session | None:
        logged = ""
        while not self._closed.wait(_AGAIN_SECONDS):
            try:
                return open_session(self._config)[0]
            except BusError as error:
                if str(error) != logged:
                    logged = str(error)
                    self._log.warning("The router is still away.", reason=logged)
        return None

    def _renew(self, declaration: Declaration[Any]) -> None:
        try:
            declaration.renew(self.current)
        except zenoh.ZError as error:
            # The link is lost again; `_run` notices it.
            self._log.warning("A declaration was not taken.", reason=str(error))
