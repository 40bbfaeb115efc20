"""What a publisher keeps of its stream, so that a receiver that lost something can ask for it."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final

SPOOL_BYTES: Final = 64 * 2**20
"""Bound of one stream's spool: 11 minutes of a rig with six drives and six responses at 1 kHz."""

_OVERHEAD_BYTES: Final = 128
"""What a message costs besides its payload: a stream of tiny ones must not grow past the bound either."""


@dataclass(frozen=True)
class Spooled:
    """A message as it was published."""

    seq: int
    payload: bytes
    encoding: str


class Spool:
    """The latest messages of one publisher, in memory: the oldest give way. Safe for threads.

    Parameters
    ----------
    largest_bytes : int
        Bound in bytes, greater than 0; each message counts its payload and 128 bytes. A message that exceeds it
        alone is not kept. What fell out cannot be replayed: its receiver reports it as missing.
    """

    def __init__(self, largest_bytes: int) -> None:
        if largest_bytes < 1:
            raise ValueError(f"A spool of {largest_bytes} bytes keeps nothing; it needs 1 or more.")
        self._largest_bytes = largest_bytes
        self._lock = threading.Lock()
        self._messages: dict[int, Spooled] = {}
        self._first = 0
        self._next = 0
        self._bytes = 0

    def append(self, payload: bytes, encoding: str) -> None:
        """Keep the next message; its sequence number is the count of those before."""
        with self._lock:
            self._messages[self._next] = Spooled(self._next, payload, encoding)
            self._next += 1
            self._bytes += len(payload) + _OVERHEAD_BYTES
            while self._bytes > self._largest_bytes:
                oldest = self._messages.pop(self._first)
                self._first += 1
                self._bytes -= len(oldest.payload) + _OVERHEAD_BYTES

    def read(self, first: int, stop: int, *, most: int) -> list[Spooled]:
        """Return the first `most` messages it has from number `first` on and before `stop`, ascending."""
        with self._lock:
            first = max(first, self._first)
            stop = min(stop, self._next, first + most)
            return [self._messages[seq] for seq in range(first, stop)]
