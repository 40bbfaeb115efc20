"""Stream data in memory that is not on disk yet: a fast publisher is held up, and nothing is dropped."""

from __future__ import annotations

import threading
import time
from typing import Any, Final

from duralab_bus import StreamItem

MOST_BYTES: Final = 128 * 1024 * 1024
# Size of a parsed message and of Python's objects for it.
_OVERHEAD_BYTES: Final = 1024


class Intake:
    """Counts the stream messages between delivery and disk; deliverers wait from `most_bytes` on. Safe for threads."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        # Arrival time of each message, in that order.
        self._since: dict[int, float] = {}
        self._closed = False
        self._changed = threading.Condition()

    def admit(self, item: StreamItem[Any]) -> None:
        """Add a delivered message; wait while there is no room for it."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._bytes < self._most_bytes)
            self._bytes += _size(item)
            self._since[id(item)] = time.monotonic()

    def settle(self, items: list[StreamItem[Any]]) -> None:
        """Remove messages that are stored or need no further work."""
        with self._changed:
            # Poses are settled too, but were not admitted: they hold nothing up.
            self._bytes -= sum(_size(item) for item in items if self._since.pop(id(item), None) is not None)
            self._changed.notify_all()

    @property
    def bytes(self) -> int:
        """Number of bytes that are not on disk yet."""
        return self._bytes

    @property
    def lag_seconds(self) -> float:
        """Time in s that the oldest message has waited; 0 if there is no message."""
        with self._changed:
            oldest = next(iter(self._since.values()), None)
        return 0.0 if oldest is None else time.monotonic() - oldest

    def close(self) -> None:
        """Release all waiting deliverers, now and later."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


def _size(item: StreamItem[Any]) -> int:
    return len(item.payload) + _OVERHEAD_BYTES
