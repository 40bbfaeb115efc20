"""The folder in which publishers keep their spools on disk, and what dead ones left in it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from pathlib import Path
from typing import Final, NamedTuple

from duralab_bus.faults import BusError
from duralab_bus.spool.disk_store import SUFFIX, DiskStore, read_header
from duralab_bus.spool.spool import Extent, Spool, SpoolSpace

SMALLEST_BYTES: Final = 16 * 2**20
FOLDER_BYTES: Final = 512 * 2**20

_LOCK: Final = "lock"


class LeftSpool(NamedTuple):
    """What a dead publisher left."""

    key: str
    epoch: int
    spool: Spool


class SpoolFolder(SpoolSpace):
    """A bounded folder of spools, shared by all publishers of a process that are given it. Safe for threads.

    Each process works in a subfolder of its own, locked while it lives; so several may share the folder, and each may
    take over what dead ones left.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    largest_bytes : int
        Bound of all spools of this process together, 16 MiB or more, counted in segments of 4 MiB.

    Raises
    ------
    BusError
        The folder cannot be written, or the bound is too small.
    """

    def __init__(self, folder: Path, *, largest_bytes: int = FOLDER_BYTES) -> None:
        if largest_bytes < SMALLEST_BYTES:
            raise BusError(
                f"A spool folder of {largest_bytes} bytes is too small; it needs {SMALLEST_BYTES} bytes or more."
            )
        super().__init__(largest_bytes, where=f"in {folder}")
        self._folder = folder
        self.path = folder / f"{time.time_ns()}-{os.getpid()}"
        try:
            self.path.mkdir(parents=True)
            self._lock = _locked(self.path)
        except OSError as error:
            raise BusError(f"No spool can be kept in {str(folder)!r}: {error.strerror or error}.") from error
        self._taken_over: list[tuple[Path, int]] = []

    def store(self, *, key: str, epoch: int) -> DiskStore:
        """Return the store of a new epoch."""
        return DiskStore(self, self.path, key=key, epoch=epoch)

    def take_over(self) -> list[LeftSpool]:
        """Take over what processes that are dead left here; what is of no publisher is left alone."""
        found: list[LeftSpool] = []
        for folder in sorted(path for path in self._folder.iterdir() if path.is_dir() and path != self.path):
            try:
                lock = _locked(folder)
            except OSError:
                continue  # Its process lives, or another one was faster.
            self._taken_over.append((folder, lock))
            for reserve in folder.glob("*.reserve"):
                reserve.unlink(missing_ok=True)
            found += self._read(folder)
        return found

    def _read(self, folder: Path) -> list[LeftSpool]:
        stores: dict[tuple[str, int], DiskStore] = {}
        for path in sorted(folder.glob(f"*{SUFFIX}")):
            content = path.read_bytes()
            header = read_header(content)
            first = path.stem.partition("-")[2]
            if header is None or not first.isdigit():
                continue
            key, epoch = header
            store = stores.setdefault(header, DiskStore(self, self.path, key=key, epoch=epoch, writable=False))
            # What follows a damaged message is of no use to a receiver that wants all; it stays on the disk.
            if not store.adopted or store.adopted.stop == int(first):
                store.adopt(path, int(first), content)
        return [LeftSpool(key, epoch, _whole(store)) for (key, epoch), store in stores.items()]

    def close(self) -> None:
        """Give the folder up; what is empty is removed."""
        for folder, lock in [(self.path, self._lock), *self._taken_over]:
            if not list(folder.glob(f"*{SUFFIX}")):
                (folder / _LOCK).unlink(missing_ok=True)
                with contextlib.suppress(OSError):
                    folder.rmdir()
            os.close(lock)
        self._taken_over.clear()


def _whole(store: DiskStore) -> Spool:
    kept = store.adopted
    return Spool(store, held=True, unheld_bytes=0, extent=Extent(first=kept.start, next=kept.stop, marked=kept.start))


def _locked(folder: Path) -> int:
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
