"""Status of a campaign or a test for its clients: readable at any time, published when it changes and repeated."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from google.protobuf.message import Message

from duralab_bus.threads import BusThread

StatusT = TypeVar("StatusT", bound=Message)

_REPEAT_SECONDS: Final = 0.5


class StatusBoard(Generic[StatusT]):
    """Status of one campaign or test. Its thread changes it; any thread may read it.

    Parameters
    ----------
    status : StatusT
        Status at the beginning.
    publish : callable
        Called with each published status, one at a time, in order, until the final one; it must not change the status.
    is_final : callable
        Whether a status is the last one.
    shortest_seconds : float
        Shortest time in seconds between two published statuses, except the final one; with 0 the thread of a change
        publishes it at once.
    """

    def __init__(
        self,
        status: StatusT,
        *,
        publish: Callable[[StatusT], None],
        is_final: Callable[[StatusT], bool],
        shortest_seconds: float = 0.0,
    ) -> None:
        self._publish = publish
        self._is_final = is_final
        self._shortest_seconds = shortest_seconds
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._changed = True
        self._published_at = 0.0
        # Replaced at every change and never modified: a reader needs no lock and never waits for the bus.
        self._status = status

    def snapshot(self) -> StatusT:
        """Return the present status; callers must not change it."""
        return self._status

    @property
    def ended(self) -> bool:
        """Whether the status is final."""
        # Under the lock: the final status is published before the event is set, and a reader may then resume at once.
        with self._lock:
            return self._ended.is_set()

    def wait_ended(self, timeout_seconds: float) -> bool:
        """Wait for the final status; return whether it is reached."""
        return self._ended.wait(timeout_seconds)

    def start_publishing(self, name: str) -> None:
        """Publish the status at changes and every half second, on a thread of this name, until the final one."""
        BusThread(self._publishing, name=name).start()

    def change(self, change: Callable[[StatusT], object]) -> None:
        """Show a changed status: `change` gets a copy. After the final status it has no effect."""
        with self._lock:
            status = self.copy()
            change(status)
            if self._ended.is_set():
                return
            self._status, self._changed = status, True
            if not self._shortest_seconds:
                self._publish_now()

    def copy(self) -> StatusT:
        """Return a copy of the present status."""
        status = type(self._status)()
        status.CopyFrom(self._status)
        return status

    def end(self, status: StatusT) -> None:
        """Publish the final status at once; later changes are ignored."""
        if not self._is_final(status):
            raise ValueError("The status is not final.")
        with self._lock:
            if not self._ended.is_set():
                self._status = status
                self._publish_now()
                self._ended.set()

    def _publish_now(self) -> None:
        """Publish the status; the caller holds the lock."""
        self._publish(self._status)
        self._changed, self._published_at = False, time.monotonic()

    def _publishing(self) -> None:
        while not self._ended.wait(self._shortest_seconds or _REPEAT_SECONDS / 2.0):
            with self._lock:
                is_due = self._changed or time.monotonic() - self._published_at >= _REPEAT_SECONDS
                if is_due and not self._ended.is_set():
                    self._publish_now()
