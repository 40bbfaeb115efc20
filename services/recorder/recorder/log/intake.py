"""Stream data in memory that are not on disk yet: a fast publisher is held up, and nothing is dropped."""

from __future__ import annotations

import threading
import time
from typing import Any, Final

from duralab_bus import StreamItem

MOST_BYTES: Final = 128 * 1024 * 1024
# A parsed message and what Python keeps about it.
_OVERHEAD_BYTES: Final = 1024


class Intake:
    """Counts the stream messages between delivery and disk; deliverers wait from `most_bytes` on. Safe for threads."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        # When each came, in that order.
        self._since: dict[int, float] = {}
        self._closed = False
        self._changed = threading.Condition()

    def admit(self, item: StreamItem[Any]) -> None:
        """Take note of a delivered message; wait while there is no room for it."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._bytes < self._most_bytes)
            self._bytes += _size(item)
            self._since[id(item)] = time.monotonic()

    def settle(self, items: list[StreamItem[Any]]) -> None:
        """Take note of messages that are safe, or that nothing is to be done about."""
        with self._changed:
            # Poses are settled as well, and were not admitted: nothing is held up for them.
            self._bytes -= sum(_size(item) for item in items if self._since.pop(id(item), None) is not None)
            self._changed.notify_all()

    @property
    def bytes(self) -> int:
        """Number of bytes that are not on disk yet."""
        return self._bytes

    @property
    def lag_seconds(self) -> float:
        """For how long the oldest of it has waited; 0 where there is none."""
        with self._changed:
            oldest = next(iter(self._since.values()), None)
        return 0.0 if oldest is None else time.monotonic() - oldest

    def close(self) -> None:
        """Hold nobody up any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


def _size(item: StreamItem[Any]) -> int:
    return len(item.payload) + _OVERHEAD_BYTES
