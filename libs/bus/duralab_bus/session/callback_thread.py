"""Thread for callbacks that must not run on Zenoh's threads: a slow callback there blocks the session."""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Final, Generic, TypeVar

import structlog

T = TypeVar("T")

_JOIN_SECONDS: Final = 2.0


class _End:
    """Last item of a queue."""


class CallbackThread(Generic[T]):
    """Thread that calls one function for each item put, in order; the queue has no bound.

    What the function raises is logged; the next item is delivered all the same.
    """

    def __init__(self, deliver: Callable[[T], None], *, name: str) -> None:
        self._deliver = deliver
        self._queue: SimpleQueue[T | _End] = SimpleQueue()
        self._log = structlog.get_logger("duralab_bus")
        self._name = name
        # A daemon: an item that is stuck must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: T) -> None:
        """Queue an item; never blocks."""
        self._queue.put(item)

    def close(self) -> None:
        """Deliver what was put before, then end; wait for it, but not for an item that is stuck."""
        self._queue.put(_End())
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN_SECONDS)

    def _run(self) -> None:
        while not isinstance(item := self._queue.get(), _End):
            try:
                self._deliver(item)
            except Exception:  # noqa: BLE001 - what the owner's callback raises must not end the stream
                self._log.exception("A callback failed.", thread=self._name)
