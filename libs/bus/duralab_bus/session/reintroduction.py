"""Links between peers, restored when one of them broke and Zenoh does not restore it.

Zenoh restores a link to an endpoint of `connect` without a time limit. A link between two peers that a third one
introduced is tried once, at the introduction: a process that was frozen gets it as soon as it runs again, while it
still takes its broken link for intact, and never afterwards. A session that joins makes all members introduce each
other again. So this module joins and leaves again when this process was frozen or a service vanished.
"""

from __future__ import annotations

import threading
import time
from typing import Final

from duralab_bus.faults import BusError
from duralab_bus.session.config import BusConfig, BusMode
from duralab_bus.session.liveliness import DEBOUNCE_SECONDS, LivelinessTracker
from duralab_bus.session.session import LEASE_SECONDS, open_session
from duralab_bus.threads import BusThread

_LOOK_SECONDS: Final = 0.5
# By then both ends of a link have noticed that it is broken.
_BROKEN_SECONDS: Final = LEASE_SECONDS + _LOOK_SECONDS
# Introducing and connecting take milliseconds on a machine that is not busy.
_STAY_SECONDS: Final = 1.0
# The members to connect to are on the bus already, or have left.
_JOINING_SECONDS: Final = 1.0
_JOIN_SECONDS: Final = 2.0
_ANY_PORT: Final = "0"


class Reintroduction:
    """Watches the links of one session; ended by `close`."""

    def __init__(self, config: BusConfig, tracker: LivelinessTracker) -> None:
        self._tracker = tracker
        self._joining = config.model_copy(
            update={
                "listen": tuple(f"{endpoint.rpartition(':')[0]}:{_ANY_PORT}" for endpoint in config.listen),
                "connect_timeout_seconds": _JOINING_SECONDS,
            }
        )
        self._closed = threading.Event()
        self._due: float | None = None
        self._thread: threading.Thread | None = None
        # A client has one link, from its configuration; a peer without `connect` is connected to by the others.
        if config.mode is BusMode.PEER and config.connect:
            self._thread = BusThread(self._run, name="duralab_bus-reintroduction")
            self._thread.start()
            tracker.subscribe(self._on_live)

    def close(self) -> None:
        """Stop watching; returns at once if no introduction is running, and within 2 s otherwise."""
        self._closed.set()
        if self._thread is not None:
            self._tracker.unsubscribe(self._on_live)
            self._thread.join(_JOIN_SECONDS)

    def _on_live(self, _service: str, _instance: str, alive: bool) -> None:
        if not alive:
            # The link may be lost, and not the service. Noticing it here has already taken a lease.
            self._due = time.monotonic() + DEBOUNCE_SECONDS

    def _run(self) -> None:
        looked = time.monotonic()
        while not self._closed.wait(_LOOK_SECONDS):
            now = time.monotonic()
            if now - looked > LEASE_SECONDS:
                self._due = now + _BROKEN_SECONDS
            looked = now
            if self._due is not None and now >= self._due:
                self._due = None
                self._introduce()
                looked = time.monotonic()

    def _introduce(self) -> None:
        try:
            session, _ = open_session(self._joining)
        except BusError:
            return  # The endpoint is gone as well. Zenoh keeps trying to reach it.
        self._closed.wait(_STAY_SECONDS)
        session.close()
