"""How much spools may take together, and where."""

from __future__ import annotations

import threading
from typing import Final

from labbus._spool import MemoryStore, Store

SPOOL_BYTES: Final = 64 * 2**20
"""Bound of one stream that nobody marks: 11 minutes of a rig with six drives and six responses at 1 kHz."""


class SpoolSpace:
    """Room in memory for the spools of the publishers that are given it. Safe for threads.

    Parameters
    ----------
    largest_bytes : int
        Bound of all of them together, greater than 0. An eighth of it is kept for what has to be published when it is
        known that there is no more room.
    where : str
        For sentences.

    Raises
    ------
    ValueError
        The bound is below 1.
    """

    def __init__(self, largest_bytes: int, *, where: str = "in memory") -> None:
        if largest_bytes < 1:
            raise ValueError(f"A spool of {largest_bytes} bytes keeps nothing; it needs 1 or more.")
        self.largest_bytes = largest_bytes
        self._where = where
        self._counting = threading.Lock()
        self._used = 0

    @property
    def shortage(self) -> str:
        """Why no more should be published; empty while there is room."""
        if self._used <= self.largest_bytes * 7 // 8:
            return ""
        return f"the spool of {self.largest_bytes / 2**20:.0f} MiB {self._where} is full"

    @property
    def full(self) -> bool:
        """Whether the bound is exceeded."""
        return self._used > self.largest_bytes

    @property
    def used_bytes(self) -> int:
        """How much is taken now."""
        return self._used

    def count(self, size: int) -> None:
        """Note bytes taken, or given back where negative."""
        with self._counting:
            self._used += size

    def store(self, *, key: str, epoch: int) -> Store:
        """Return the store of a new epoch."""
        del key, epoch
        return MemoryStore(self)

    def close(self) -> None:
        """Give the room up, when all publishers are closed."""
