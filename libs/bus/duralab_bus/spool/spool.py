"""Spool of a publisher for replay, and the memory limit of all publishers."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from typing import Final, NamedTuple

OVERHEAD_BYTES: Final = 128
"""Size of a message in bytes besides its payload: a stream of tiny messages must not exceed the bound either."""

SPOOL_BYTES: Final = 64 * 2**20
"""Bound in bytes of a stream without acknowledgements: 11 min of a rig with six drives and six responses at 1 kHz."""


class SpoolFullError(RuntimeError):
    """A message could not be kept and was not published; one sentence with the reason."""


class Spooled(NamedTuple):
    """Message as it was published."""

    seq: int
    payload: bytes
    encoding: str


class Store(ABC):
    """Store of the messages of one epoch, in memory or on disk. Used under its spool's lock."""

    def __init__(self, space: SpoolSpace) -> None:
        self._space = space

    @property
    def shortage(self) -> str:
        """Reason to store only what is necessary; empty while there is room."""
        return self._space.shortage

    @property
    def full(self) -> bool:
        """Whether the bound of the space is exceeded."""
        return self._space.full

    @property
    @abstractmethod
    def size(self) -> int:
        """Size in bytes."""

    @abstractmethod
    def append(self, seq: int, payload: bytes, encoding: str) -> None:
        """Keep the next message; raises OSError if that fails."""

    @abstractmethod
    def read(self, seqs: range) -> list[Spooled]:
        """Return kept messages."""

    @abstractmethod
    def drop_before(self, seq: int) -> None:
        """Release messages below a number, as far as possible."""

    @abstractmethod
    def drop_oldest(self) -> int | None:
        """Release the oldest messages; return the lowest number that is left, or None if none can be released."""

    @abstractmethod
    def close(self, *, delete: bool) -> None:
        """Release the messages in this process; those on disk stay there unless `delete` is set."""


class _MemoryStore(Store):
    """Messages in memory."""

    def __init__(self, space: SpoolSpace) -> None:
        super().__init__(space)
        self._messages: deque[Spooled] = deque()
        self._bytes = 0

    @property
    def size(self) -> int:
        return self._bytes

    def append(self, seq: int, payload: bytes, encoding: str) -> None:
        self._messages.append(Spooled(seq, payload, encoding))
        self._take(len(payload) + OVERHEAD_BYTES)

    def read(self, seqs: range) -> list[Spooled]:
        if not seqs:
            return []
        base = self._messages[0].seq
        return [self._messages[seq - base] for seq in seqs]

    def drop_before(self, seq: int) -> None:
        while self._messages and self._messages[0].seq < seq:
            self.drop_oldest()

    def drop_oldest(self) -> int | None:
        if not self._messages:
            return None
        oldest = self._messages.popleft()
        self._take(-len(oldest.payload) - OVERHEAD_BYTES)
        return oldest.seq + 1

    def close(self, *, delete: bool) -> None:
        del delete
        self._messages.clear()
        self._take(-self._bytes)

    def _take(self, size: int) -> None:
        self._bytes += size
        self._space.count(size)


class SpoolSpace:
    """Room in memory for the spools of the publishers that use it. Safe for threads.

    Parameters
    ----------
    largest_bytes : int
        Bound of all spools together, greater than 0. An eighth of it is reserved for messages that must still be
        published after a shortage is reported.
    where : str
        Place of the spools, for messages.

    Raises
    ------
    ValueError
        If the bound is below 1.
    """

    def __init__(self, largest_bytes: int, *, where: str = "in memory") -> None:
        if largest_bytes < 1:
            raise ValueError(f"A spool of {largest_bytes} bytes keeps nothing; it needs 1 or more.")
        self.largest_bytes = largest_bytes
        self._where = where
        self._counting = threading.Lock()
        self.used_bytes = 0
        """Number of bytes used now."""

    @property
    def shortage(self) -> str:
        """Reason to stop publishing; empty while there is room."""
        if self.used_bytes <= self.largest_bytes * 7 // 8:
            return ""
        return f"the spool of {self.largest_bytes / 2**20:.0f} MiB {self._where} is full"

    @property
    def full(self) -> bool:
        """Whether the bound is exceeded."""
        return self.used_bytes > self.largest_bytes

    def count(self, size: int) -> None:
        """Add to the used bytes; a negative size releases."""
        with self._counting:
            self.used_bytes += size

    def store(self, *, key: str, epoch: int) -> Store:
        """Return the store of a new epoch."""
        del key, epoch
        return _MemoryStore(self)

    def close(self) -> None:
        """Release the room after all publishers are closed."""


class Extent(NamedTuple):
    """Extent of a spool: `first` to `next` can be replayed, all below `marked` are stored elsewhere."""

    first: int
    next: int
    marked: int


class Spool:
    """Spool of one epoch, and the part that is not stored elsewhere yet. Safe for threads.

    It is `held` if a receiver stores the stream and acknowledges it by marks: then no unmarked message is dropped, and
    a full store refuses new ones. Otherwise the oldest are dropped, beyond `unheld_bytes`. `extent` is that of an
    existing store.
    """

    def __init__(self, store: Store, *, held: bool, unheld_bytes: int, extent: Extent | None = None) -> None:
        self._store = store
        self._lock = threading.Lock()
        self.held = held
        """Whether a receiver acknowledges stored messages, so that unmarked ones are kept."""
        self._unheld_bytes = unheld_bytes
        # Three numbers: making a tuple of them for every message took as long as computing its checksum.
        self._first, self._next, self._marked = extent or Extent(first=0, next=0, marked=0)

    @property
    def extent(self) -> Extent:
        """Present extent of the spool."""
        with self._lock:
            return Extent(self._first, self._next, self._marked)

    @property
    def unmarked(self) -> int:
        """Number of messages that are not marked."""
        with self._lock:
            return self._next - self._marked

    @property
    def settled(self) -> bool:
        """Whether no receiver needs the spool any more: all of it is marked."""
        return self.held and self._marked >= self._next

    @property
    def shortage(self) -> str:
        """Reason to stop publishing until more is marked; empty while there is room."""
        with self._lock:
            return self._store.shortage if self.held else ""

    def append(self, payload: bytes, encoding: str) -> int:
        """Keep the next message and return its number, the count of those before.

        Raises `SpoolFullError`: It cannot be kept without dropping another one that is not marked, or the disk refuses
        it.
        """
        with self._lock:
            seq = self._next
            if self.held and self._store.full:
                raise SpoolFullError(f"{self._store.shortage}, with {seq - self._marked} messages not stored.")
            try:
                self._store.append(seq, payload, encoding)
            except OSError as error:
                raise SpoolFullError(f"the spool cannot be written: {error.strerror or error}.") from error
            self._next = seq + 1
            while self._too_much and (lowest := self._store.drop_oldest()) is not None:
                self._first = lowest
            return seq

    @property
    def _too_much(self) -> bool:
        return not self.held and (self._store.full or self._store.size > self._unheld_bytes)

    def read(self, first: int, stop: int, *, most: int) -> list[Spooled]:
        """Return the first `most` kept messages from number `first` on and before `stop`, ascending."""
        with self._lock:
            first = max(first, self._first)
            return self._store.read(range(first, min(stop, self._next, first + most)))

    def mark(self, marked: int) -> None:
        """Note that all messages below a number are stored elsewhere; release them. From now on the spool is held."""
        with self._lock:
            self.held = True
            self._marked = min(max(marked, self._marked), self._next)
            self._first = max(self._first, self._marked)
            self._store.drop_before(self._first)

    def close(self, *, delete: bool) -> None:
        """Release the messages in this process; unmarked ones on disk stay there unless `delete` is set."""
        with self._lock:
            self._store.close(delete=delete or not self.held or self._marked >= self._next)
            self._first = self._next
