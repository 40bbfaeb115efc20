"""Folder of publishers' spools on disk, including the spools of dead processes."""

from __future__ import annotations

import contextlib
import json
import os
import struct
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import xxhash

from duralab_bus.faults import BusError
from duralab_bus.spool.segment_file import allocate, read_at, write_at
from duralab_bus.spool.spool import Extent, Spool, Spooled, SpoolSpace, Store
from duralab_settings import OPEN_BINARY, lock_file

SEGMENT_BYTES: Final = 4 * 2**20
SUFFIX: Final = ".spool"
_MAGIC: Final = b"DURASPL3"
_HEAD: Final = struct.Struct("<8sI")
_RECORD: Final = struct.Struct("<IHQ")
"""Bytes of the payload plus one, so that no record begins with zeros; bytes of the encoding; checksum of epoch, number,
encoding and payload."""
_POSITION: Final = struct.Struct("<QQ")
# Segments that a receiver that stores a few times a second frees at once, at the highest measured rate of a stream.
_MOST_SPARES: Final = 32


@dataclass
class _Segment:
    """File of consecutive messages; `offsets` are the positions of their records."""

    path: Path
    descriptor: int
    epoch: int
    first: int
    size: int
    end: int
    offsets: list[int] = field(default_factory=list)

    @property
    def stop(self) -> int:
        return self.first + len(self.offsets)

    def read(self, seq: int) -> Spooled | None:
        """Return a message, or None if its record is damaged."""
        offset = self.offsets[seq - self.first]
        stop = self.offsets[seq - self.first + 1] if seq + 1 < self.stop else self.end
        return _parse(read_at(self.descriptor, stop - offset, offset), self.epoch, seq)


def _parse(record: bytes, epoch: int, seq: int) -> Spooled | None:
    if len(record) < _RECORD.size:
        return None
    length, encoding_length, checksum = _RECORD.unpack_from(record)
    body = memoryview(record)[_RECORD.size :]
    if length == 0 or len(body) < length - 1 + encoding_length:
        return None
    body = body[: length - 1 + encoding_length]
    encoding, payload = bytes(body[:encoding_length]), bytes(body[encoding_length:])
    if _checksum(epoch, seq, encoding, payload) != checksum:
        return None
    return Spooled(seq, payload=payload, encoding=encoding.decode())


def _checksum(epoch: int, seq: int, encoding: bytes, payload: bytes) -> int:
    # 13 KB take half a microsecond; zlib's CRC-32 takes five, which was a tenth of a publisher's cost of a block.
    return xxhash.xxh3_64_intdigest(payload, xxhash.xxh3_64_intdigest(_POSITION.pack(epoch, seq) + encoding))


class _DiskStore(Store):
    """Messages of one epoch in a folder; the bound is that of the space, which is shared with other stores.

    A reserve segment is always allocated before it is needed: a full disk is noticed while there is room for the
    messages that must still be written.
    """

    def __init__(self, space: SpoolSpace, folder: Path, *, key: str, epoch: int, writable: bool = True) -> None:
        super().__init__(space)
        self._folder = folder
        self._epoch = epoch
        header = json.dumps({"key": key, "epoch": epoch}).encode()
        self._header = _HEAD.pack(_MAGIC, len(header)) + header
        self._segments: list[_Segment] = []
        self._spares: list[Path] = []
        self._refusal = ""
        if writable:
            self._reserve()

    @property
    def shortage(self) -> str:
        # A disk that refused is checked again.
        if self._refusal:
            self._reserve()
        return self._refusal or self._space.shortage

    @property
    def size(self) -> int:
        return sum(segment.size for segment in self._segments)

    def append(self, seq: int, payload: bytes, encoding: str) -> None:
        kind = encoding.encode()
        head = _RECORD.pack(len(payload) + 1, len(kind), _checksum(self._epoch, seq, kind, payload)) + kind
        size = len(head) + len(payload)
        if not self._segments or self._segments[-1].end + size > self._segments[-1].size:
            self._begin(seq, least=size)
        segment = self._segments[-1]
        if write_at(segment.descriptor, [head, payload], segment.end) != size:
            raise OSError(0, "only a part was written, the disk is full")
        segment.offsets.append(segment.end)
        segment.end += size

    def read(self, seqs: range) -> list[Spooled]:
        """Read messages; those with a damaged record are left out."""
        found: list[Spooled] = []
        for segment in self._segments:
            inside = range(max(seqs.start, segment.first), min(seqs.stop, segment.stop))
            found += [message for seq in inside if (message := segment.read(seq)) is not None]
        return found

    def drop_before(self, seq: int) -> None:
        """Delete the segments that lie below a number."""
        while len(self._segments) > 1 and self._segments[0].stop <= seq:
            self.drop_oldest()

    def drop_oldest(self) -> int | None:
        """Delete the oldest segment, unless it is being written; return the lowest number that is left."""
        if len(self._segments) < 2:
            return None
        self._release(self._segments.pop(0))
        return self._segments[0].first

    def close(self, *, delete: bool) -> None:
        for segment in self._segments:
            if delete:
                self._delete(segment)
            else:
                os.close(segment.descriptor)
        self._segments.clear()
        for spare in self._spares:
            spare.unlink(missing_ok=True)
            self._space.count(-SEGMENT_BYTES)
        self._spares.clear()

    def adopt(self, path: Path, first: int, content: bytes) -> None:
        """Adopt a segment of this key and epoch from a dead process, up to its first damaged message."""
        segment = _Segment(
            path, os.open(path, os.O_RDONLY | OPEN_BINARY), self._epoch, first, size=len(content), end=len(self._header)
        )
        while True:
            record = content[segment.end : segment.end + _longest(content, segment.end)]
            if (message := _parse(record, self._epoch, segment.stop)) is None:
                break
            segment.offsets.append(segment.end)
            segment.end += _RECORD.size + len(message.encoding.encode()) + len(message.payload)
        self._segments.append(segment)
        self._space.count(segment.size)

    @property
    def adopted(self) -> range:
        """Range of the adopted message numbers."""
        return range(self._segments[0].first, self._segments[-1].stop) if self._segments else range(0)

    def _begin(self, first: int, *, least: int) -> None:
        size = max(SEGMENT_BYTES, len(self._header) + least)
        path = self._folder / f"{self._epoch}-{first:020}{SUFFIX}"
        if size == SEGMENT_BYTES and self._spares:
            self._spares.pop().rename(path)
        else:
            self._take(path, size)
        descriptor = os.open(path, os.O_RDWR | OPEN_BINARY)
        write_at(descriptor, [self._header], 0)
        self._segments.append(_Segment(path, descriptor, self._epoch, first, size=size, end=len(self._header)))
        if not self._spares:
            self._reserve()

    def _reserve(self) -> None:
        spare = self._folder / f"{self._epoch}.reserve"
        try:
            self._take(spare, SEGMENT_BYTES)
        except OSError as error:
            self._refusal = f"the disk of the spool {self._folder} refuses more: {error.strerror or error}"
        else:
            self._spares.append(spare)
            self._refusal = ""

    def _take(self, path: Path, size: int) -> None:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | OPEN_BINARY, 0o644)
        try:
            allocate(descriptor, size)
        except OSError:
            os.close(descriptor)
            with contextlib.suppress(OSError):
                path.unlink()
            raise
        os.close(descriptor)
        self._space.count(size)

    def _release(self, segment: _Segment) -> None:
        """Keep a segment for reuse, or delete it if room is short."""
        roomy = self._space.used_bytes < self._space.largest_bytes // 2
        if segment.size != SEGMENT_BYTES or len(self._spares) >= _MOST_SPARES or not roomy or self._refusal:
            self._delete(segment)
            return
        os.close(segment.descriptor)
        spare = segment.path.with_suffix(".reserve")
        segment.path.rename(spare)
        self._spares.append(spare)

    def _delete(self, segment: _Segment) -> None:
        os.close(segment.descriptor)
        segment.path.unlink(missing_ok=True)
        self._space.count(-segment.size)


def _longest(content: bytes, offset: int) -> int:
    """Return the size in bytes that the record at an offset states."""
    if len(content) < offset + _RECORD.size:
        return 0
    length, encoding_length, _ = _RECORD.unpack_from(content, offset)
    return _RECORD.size + length + encoding_length


def read_header(content: bytes) -> tuple[str, int] | None:
    """Return key and epoch of a segment, or None if the content is not a segment."""
    if len(content) < _HEAD.size:
        return None
    magic, length = _HEAD.unpack_from(content)
    if magic != _MAGIC:
        return None
    try:
        header = json.loads(content[_HEAD.size : _HEAD.size + length])
        return str(header["key"]), int(header["epoch"])
    except (ValueError, KeyError, TypeError):
        return None


SMALLEST_BYTES: Final = 16 * 2**20
FOLDER_BYTES: Final = 512 * 2**20

_LOCK: Final = "lock"


class LeftSpool(NamedTuple):
    """Spool of a dead publisher."""

    key: str
    epoch: int
    spool: Spool


class SpoolFolder(SpoolSpace):
    """Bounded folder of spools, shared by all publishers of a process that use it. Safe for threads.

    Each process works in its own subfolder, locked while it runs; so several processes may share the folder, and each
    may take over the spools of dead ones.

    Parameters
    ----------
    folder : Path
        Folder of the spools; created if missing.
    largest_bytes : int
        Bound of all spools of this process together, 16 MiB or more, counted in segments of 4 MiB.

    Raises
    ------
    BusError
        If the folder cannot be written or the bound is too small.
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
            self._lock = lock_file(self.path / _LOCK)
        except OSError as error:
            raise BusError(f"No spool can be kept in {str(folder)!r}: {error.strerror or error}.") from error
        self._taken_over: list[tuple[Path, int]] = []

    def store(self, *, key: str, epoch: int) -> _DiskStore:
        """Return the store of a new epoch."""
        return _DiskStore(self, self.path, key=key, epoch=epoch)

    def take_over(self) -> list[LeftSpool]:
        """Take over the spools of dead processes in this folder; files of no publisher are left alone."""
        found: list[LeftSpool] = []
        for folder in sorted(path for path in self._folder.iterdir() if path.is_dir() and path != self.path):
            try:
                lock = lock_file(folder / _LOCK)
            except OSError:
                continue  # Its process lives, or another process was faster.
            self._taken_over.append((folder, lock))
            for reserve in folder.glob("*.reserve"):
                reserve.unlink(missing_ok=True)
            found += self._read(folder)
        return found

    def _read(self, folder: Path) -> list[LeftSpool]:
        stores: dict[tuple[str, int], _DiskStore] = {}
        for path in sorted(folder.glob(f"*{SUFFIX}")):
            content = path.read_bytes()
            header = read_header(content)
            first = path.stem.partition("-")[2]
            if header is None or not first.isdigit():
                continue
            key, epoch = header
            store = stores.setdefault(header, _DiskStore(self, self.path, key=key, epoch=epoch, writable=False))
            # Messages after a damaged one are of no use to a receiver that needs all; they stay on the disk.
            if not store.adopted or store.adopted.stop == int(first):
                store.adopt(path, int(first), content)
        return [LeftSpool(key, epoch, _whole(store)) for (key, epoch), store in stores.items()]

    def close(self) -> None:
        """Release the folder; empty subfolders are removed."""
        for folder, lock in [(self.path, self._lock), *self._taken_over]:
            # Remove the empty folder's lock file before the lock is released, so that no other process takes the
            # folder over meanwhile. Windows cannot remove an open file.
            empty = not list(folder.glob(f"*{SUFFIX}"))
            if empty and sys.platform != "win32":
                (folder / _LOCK).unlink(missing_ok=True)
            os.close(lock)
            if empty:
                with contextlib.suppress(OSError):
                    (folder / _LOCK).unlink(missing_ok=True)
                    folder.rmdir()
        self._taken_over.clear()


def _whole(store: _DiskStore) -> Spool:
    kept = store.adopted
    return Spool(store, held=True, unheld_bytes=0, extent=Extent(first=kept.start, next=kept.stop, marked=kept.start))
