"""A Zenoh session, and after its router was away another one in its place.

A router that was frozen finds the old links of its clients broken and their new ones waiting, both at once. Zenoh
1.10.2 then takes a client that comes back under its old id for the one that it is just letting go: in a trace two of
three were refused at first, and the third was attached to the transport that was being closed. A session that comes
back under another id is nobody's old one.
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
from duralab_proto.v1 import query_pb2

# Zenoh itself tries again at once and after 50 ms (`session.py`): a router that is there has the link back by then.
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
        """As Zenoh gave it; None as long as the router has been away since it was to be declared."""

    def renew(self, session: zenoh.Session) -> None:
        """Declare it on a session."""
        self.current = self._declare(session)

    def undeclare(self) -> None:
        """Declare it no more."""
        self._owner.forget(self)
        if self.current is not None:
            # With a session that is closed it is gone already.
            with suppress(zenoh.ZError):
                self.current.undeclare()


class Inbox(Declaration[ReceivedT]):
    """A declaration to whose channel, of Zenoh's own, something comes; made by `BusSession.receive`."""

    def __init__(self, owner: BusSession, declare: Callable[[zenoh.Session], ReceivedT]) -> None:
        super().__init__(owner, declare)
        self._channel: Any = None

    def renew(self, session: zenoh.Session) -> None:
        """Declare it on a session; what waits in the channel of another one is left there."""
        super().renew(session)
        self._channel = None if self.current is None else self.current.handler

    def next(self) -> Any | None:
        """Wait for the next one, over as many sessions as it takes; None once it is declared no more."""
        while True:
            channel = self._channel
            if channel is not None:
                with suppress(zenoh.ZError):
                    return channel.recv()
            if not self._owner.wait_until(self, lambda channel=channel: self._channel is not channel):
                return None

    def next_at_once(self) -> Any | None:
        """Return the next one that is there already; None where there is none."""
        if self._channel is None:
            return None
        # Once for each message, and a `with` takes 0.6 µs.
        try:
            return self._channel.try_recv()
        except zenoh.ZError:
            return None


_AnyDeclaration = TypeVar("_AnyDeclaration", bound=Declaration[Any])


class BusSession:
    """The session of a bus: Zenoh's, and for a client another one when its router was away."""

    def __init__(self, session: zenoh.Session, config: BusConfig) -> None:
        self.current = session
        """Zenoh's session; closed while the router is away."""
        self.linked = time.monotonic()
        """When its link was made, on the monotonic clock in s: at first, by a session in its place, or by Zenoh."""
        self.lost = -math.inf
        """When a client last lost its link to the router, on the monotonic clock in s."""
        self._config = config
        self._changed = threading.Condition()
        self._declarations: dict[Declaration[Any], None] = {}
        self.away = False
        """Whether its router is away: what is declared now is declared when it is back, and nothing is sent."""
        self._closed = threading.Event()
        self._broken = threading.Event()
        self._log = structlog.get_logger("duralab_bus")
        if config.mode is BusMode.CLIENT:
            self._listener = self._listen()
            threading.Thread(target=self._run, name="duralab_bus-rejoining", daemon=True).start()

    @property
    def closed(self) -> bool:
        """Whether it was closed by its owner, and does not come back."""
        return self._closed.is_set()

    @property
    def router(self) -> str:
        """The router of a client, as a sentence names it."""
        return f"the router at {', '.join(self._config.connect)}"

    def disturbed(self, since: float) -> bool:
        """Return whether a client is without its link to the router, or lost it or has it back since a moment."""
        return self.away or self.lost > self.linked or (self.lost > -math.inf and self.linked >= since)

    def expect_router(self, key: str, session: zenoh.Session | None = None) -> None:
        """Raise FaultError UNAVAILABLE while the router is away, or where it has been since a session was the one."""
        if not self.closed and (self.away or session not in (None, self.current)):
            raise FaultError(
                query_pb2.FAULT_CODE_UNAVAILABLE,
                f"T{self.router[1:]} is away or was just now, so nothing was sent on {key}; "
                "see that it runs, and ask again.",
            )

    def declare(self, declare: Callable[[zenoh.Session], DeclaredT]) -> Declaration[DeclaredT]:
        """Declare something on this session and on each that takes its place."""
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
        """Declare something no more on what takes this session's place."""
        with self._changed:
            self._declarations.pop(declaration, None)
            self._changed.notify_all()

    def wait_until(self, declaration: Declaration[Any], changed: Callable[[], bool]) -> bool:
        """Wait until something has changed; return False once the declaration is forgotten, or the session closed."""
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
        # Closing waits for Zenoh's own threads; a stuck link must not hold up the others.
        closing = threading.Thread(target=self.current.close, name="duralab_bus-close", daemon=True)
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
        # First, so that it does not come back as well.
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
            # Its link is gone once more, which is noticed by itself.
            self._log.warning("A declaration was not taken.", reason=str(error))
