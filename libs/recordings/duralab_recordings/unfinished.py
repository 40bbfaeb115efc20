"""Records of a file from its start, as far as it is intact; also of a file that was never finished.

A recorder that is killed leaves a file with an arbitrary end. All records before it are whole and have their checksums.
"""

from __future__ import annotations

import errno
import os
import stat
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk

from duralab_recordings.damage import DAMAGE

MAGIC: Final = b"\x89MCAP0\r\n"
LARGEST_RECORD: Final = 5 * 2**28
"""Largest record in bytes, 1.25 GiB: the bus carries messages of 1 GiB at most. A larger one is damage."""

_HEAD: Final = struct.Struct("<BQ")
_CHUNK_KIND: Final = bytes([Opcode.CHUNK])
# Head, two times, size, checksum and the length of the compression's name; the name and the length of the records
# follow.
_CHUNK_HEAD: Final = struct.Struct("<BQQQQII")
_COMPRESSIONS: Final = (b"", b"lz4", b"zstd")
_LENGTH_BYTES: Final = 8
_BLOCK_BYTES: Final = 1024 * 1024
FOOTER_BYTES: Final = 20
_CRC_BYTES: Final = 4

Take = Callable[[McapRecord], None]
"""Callback for each schema, channel, message, metadata and attachment, in order."""


@dataclass
class Unfinished:
    """Intact part of a file without an end.

    Parameters
    ----------
    end : int
        Position of its end: the bytes after it were being written and are not part of it.
    crc : int
        CRC-32 of all bytes before the end.
    schemas, channels : dict
        Records of the file, by their number.
    chunks, attachments, metadata : list
        Index entries of the part before the end, in its order.
    message_counts : dict of int to int
        Number of messages of each channel.
    """

    end: int = 0
    crc: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    message_counts: dict[int, int] = field(default_factory=dict)


class ZerosError(McapError):
    """Zeros instead of a record, as a power cut or a failing disk leaves them."""


class RecordReader(StreamReader):
    """Reader of records in order, with all checksums; refuses zeros, which it would step through nine bytes at a time.

    Parameters
    ----------
    stream : file
        Stream open for reading, at its beginning.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream, validate_crcs=True, record_size_limit=LARGEST_RECORD)

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode == 0:
            raise ZerosError(f"at byte {self._stream.count - _HEAD.size} are zeros where a record was to come")
        return super()._read_record(opcode, length)


def is_finished(path: Path) -> bool:
    """Return whether a file ends as a complete MCAP file does; the rest is not checked.

    Parameters
    ----------
    path : Path
        Path of the file.

    Returns
    -------
    bool
        Whether the file ends with a footer and the magic bytes.
    """
    least = 2 * len(MAGIC) + _HEAD.size + FOOTER_BYTES
    with path.open("rb") as stream:
        if stream.seek(0, os.SEEK_END) < least:
            return False
        stream.seek(-len(MAGIC) - FOOTER_BYTES - _HEAD.size, os.SEEK_END)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        return (opcode, length) == (Opcode.FOOTER, FOOTER_BYTES) and stream.read()[-len(MAGIC) :] == MAGIC


def check_begin(path: Path) -> None:
    """Check that a file begins as an MCAP file does, for a file of any length.

    Parameters
    ----------
    path : Path
        Path of the file.

    Raises
    ------
    InvalidMagic
        If it begins otherwise.
    OSError
        If it is a FIFO, a socket or a device, which would block its reader without end, or cannot be read.
    """
    kind = stat.S_IFMT(path.stat().st_mode)
    if kind not in (stat.S_IFREG, stat.S_IFDIR):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    with path.open("rb") as stream:
        begin = stream.read(len(MAGIC))
    if not MAGIC.startswith(begin):
        raise InvalidMagic(begin)


def scan(path: Path, take: Take) -> Unfinished:
    """Read a file from its start as far as it is intact, with all checksums, one record in memory at a time.

    Parameters
    ----------
    path : Path
        File that was written in chunks; an ending is left out.
    take : callable
        Called with each record; an error that it raises ends the scan.

    Returns
    -------
    Unfinished
        Intact part, with `end` 0 if the file does not even begin as an MCAP file.

    Raises
    ------
    McapError
        If it is damaged in its middle: the records after that are whole, so that no kill ended it there.
    """
    found = Unfinished()
    with path.open("rb") as stream:
        for record in whole_records(stream, found):
            take(record)
    return found


def is_begun(path: Path) -> bool:
    """Return whether anything was recorded in a file, or whether a kill came before its first message.

    Parameters
    ----------
    path : Path
        Path of the file.

    Returns
    -------
    bool
        False if it holds no whole message. True also for a file that is damaged or cannot be read: its reader shows
        the reason.
    """
    try:
        check_begin(path)
        with path.open("rb") as stream:
            # As a repair reads it: a chunk without its indexes is cut off.
            return any(isinstance(record, Message) for record in whole_records(stream, Unfinished()))
    except (*DAMAGE, OSError):
        return True


def whole_records(stream: IO[bytes], found: Unfinished | None = None) -> Iterator[McapRecord]:
    """Yield the records for `scan`, with one chunk in memory at a time."""
    noted = Unfinished() if found is None else found
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        return
    noted.end, noted.crc = len(MAGIC), zlib.crc32(MAGIC)
    while (group := _Group.read(stream, start=noted.end)) is not None and not group.torn:
        yield from group.note(noted)
    if group is not None and found is None:
        yield from group.inner


def end_of_records(stream: IO[bytes]) -> int:
    """Return the position after the last record with all its bytes; the content of records is not read.

    Zeros up to the end of the file are no records: a power cut leaves them instead of data.
    """
    size = stream.seek(0, os.SEEK_END)
    end = len(MAGIC)
    while end + _HEAD.size <= size:
        stream.seek(end)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        if opcode == 0:
            if _zeros_end(stream, end) < size:
                raise McapError(f"at byte {end} are zeros where a record was to come, and other bytes follow")
            break
        if length > LARGEST_RECORD:
            return size
        if end + _HEAD.size + length > size:
            break
        end += _HEAD.size + length
    return end


def _zeros_end(stream: IO[bytes], start: int) -> int:
    """Return the position of the first byte that is not zero; holes of a sparse file are not read."""
    position = start
    while (data := _next_data(stream, position)) is not None:
        position = data
        stream.seek(position)
        block = stream.read(_BLOCK_BYTES)
        if rest := block.lstrip(b"\0"):
            return position + len(block) - len(rest)
        position += len(block)
    return stream.seek(0, os.SEEK_END)


@dataclass
class _Group:
    """A record, or a chunk with its message indexes: whole, or taken for not written."""

    start: int
    data: bytes
    opcode: int
    indexes: dict[int, tuple[int, int]] = field(default_factory=dict)
    inner: list[McapRecord] = field(default_factory=list)
    torn: bool = False
    """Whether it is the last group and parts after its chunk are missing."""

    @staticmethod
    def read(stream: IO[bytes], *, start: int) -> _Group | None:
        record = _read_record(stream)
        if record is None:
            return None
        group = _Group(start=start, data=record[1], opcode=record[0])
        match group.opcode:
            case Opcode.DATA_END | Opcode.FOOTER:
                _refuse_whole_chunk_after(stream, stream.tell())
                return None
            case Opcode.HEADER | Opcode.METADATA:
                sound = True
            case Opcode.ATTACHMENT:
                sound = _attachment_is_sound(group.data)
            case Opcode.CHUNK:
                sound = group._read_chunk(stream)
            case _:
                sound = False
        if not sound:
            _expect_last(stream, start)
            group.torn = True
        return group

    def _read_chunk(self, stream: IO[bytes]) -> bool:
        """Read the content of the chunk, and the indexes after it; return whether all of it exists."""
        try:
            self.inner = breakup_chunk(Chunk.read(_body(self.data)), validate_crc=True)
        except (*DAMAGE, MemoryError):
            return False
        wanted = {record.channel_id for record in self.inner if isinstance(record, Message)}
        while wanted:
            record = _read_record(stream)
            if record is None or record[0] != Opcode.MESSAGE_INDEX:
                return False
            index = MessageIndex.read(_body(record[1]))
            self.indexes[index.channel_id] = (len(self.data), len(index.records))
            self.data += record[1]
            wanted.discard(index.channel_id)
        return True

    def note(self, found: Unfinished) -> Iterator[McapRecord]:
        body = _body(self.data)
        match self.opcode:
            case Opcode.CHUNK:
                self._note_chunk(found, Chunk.read(body))
                yield from self.inner
            case Opcode.METADATA:
                metadata = Metadata.read(body)
                found.metadata.append(MetadataIndex(offset=self.start, length=len(self.data), name=metadata.name))
                yield metadata
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(body)
                found.attachments.append(
                    AttachmentIndex(
                        offset=self.start,
                        length=len(self.data),
                        log_time=attachment.log_time,
                        create_time=attachment.create_time,
                        data_size=len(attachment.data),
                        name=attachment.name,
                        media_type=attachment.media_type,
                    )
                )
                yield attachment
        found.end = self.start + len(self.data)
        found.crc = zlib.crc32(self.data, found.crc)

    def _note_chunk(self, found: Unfinished, chunk: Chunk) -> None:
        for record in self.inner:
            match record:
                case Schema():
                    found.schemas[record.id] = record
                case Channel():
                    found.channels[record.id] = record
        length = min((offset for offset, _ in self.indexes.values()), default=len(self.data))
        for channel, (_, count) in self.indexes.items():
            found.message_counts[channel] = found.message_counts.get(channel, 0) + count
        found.chunks.append(
            ChunkIndex(
                chunk_start_offset=self.start,
                chunk_length=length,
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                message_index_offsets={channel: self.start + offset for channel, (offset, _) in self.indexes.items()},
                message_index_length=len(self.data) - length,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )


def _read_record(stream: IO[bytes]) -> tuple[int, bytes] | None:
    """Return the kind and all bytes of the next record, or None if it is not complete."""
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    opcode, length = _HEAD.unpack(head)
    left = os.fstat(stream.fileno()).st_size - stream.tell()
    # Kind 0 is not a record: a power cut may leave zeros instead of data.
    if opcode == 0 or length > min(left, LARGEST_RECORD):
        _refuse_whole_chunk_after(stream, stream.tell())
        return None
    return opcode, head + stream.read(length)


def _refuse_whole_chunk_after(stream: IO[bytes], position: int) -> None:
    """Raise McapError if a whole chunk follows: then the bytes before it are damaged, and not the file's end."""
    if any(_is_whole_chunk(stream, start, length) for start, length in _chunk_heads(stream, position)):
        raise McapError(f"what lies before byte {position} is not what was written, and others follow it")
    stream.seek(position)


def _chunk_heads(stream: IO[bytes], start: int) -> Iterator[tuple[int, int]]:
    """Yield position and length of every possible chunk; holes of a sparse file are not read."""
    size = os.fstat(stream.fileno()).st_size
    position = start
    while (data := _next_data(stream, position)) is not None:
        position = data
        stream.seek(position)
        # For a kind at the end of a block, the length is after the block.
        block = stream.read(_BLOCK_BYTES + _HEAD.size - 1)
        at = block.find(_CHUNK_KIND, 0, _BLOCK_BYTES)
        while at >= 0:
            length = int.from_bytes(block[at + 1 : at + _HEAD.size], "little")
            if length <= min(size - position - at - _HEAD.size, LARGEST_RECORD):
                yield position + at, length
            at = block.find(_CHUNK_KIND, at + 1, _BLOCK_BYTES)
        position += _BLOCK_BYTES


def _next_data(stream: IO[bytes], start: int) -> int | None:
    """Return the position of the next stored byte from `start` on; None if only a hole follows."""
    if sys.platform == "win32":
        # The system does not report the holes: they are read, as zeros.
        return start if start < os.fstat(stream.fileno()).st_size else None
    descriptor = stream.fileno()
    # The stream's buffer depends on the position of its descriptor.
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        return os.lseek(descriptor, start, os.SEEK_DATA)
    except OSError as error:
        if error.errno == errno.ENXIO:
            return None
        raise
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)


def _is_whole_chunk(stream: IO[bytes], start: int, length: int) -> bool:
    stream.seek(start)
    content = stream.read(_CHUNK_HEAD.size + max(map(len, _COMPRESSIONS)) + _LENGTH_BYTES)
    if len(content) < _CHUNK_HEAD.size + _LENGTH_BYTES:
        return False
    name_length = _CHUNK_HEAD.unpack_from(content)[-1]
    name, records = content[_CHUNK_HEAD.size :][:name_length], content[_CHUNK_HEAD.size + name_length :]
    before = _CHUNK_HEAD.size - _HEAD.size + name_length + _LENGTH_BYTES
    # Only then the chunk is read: nearly every byte that looks like the start of a chunk is not one.
    if name not in _COMPRESSIONS or before + int.from_bytes(records[:_LENGTH_BYTES], "little") != length:
        return False
    stream.seek(start + _HEAD.size)
    try:
        return bool(breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True))
    except (*DAMAGE, MemoryError):
        return False


def _expect_last(stream: IO[bytes], start: int) -> None:
    """Accept a last record with wrong content, as a power cut leaves it; elsewhere it is damage."""
    position = stream.tell()
    if _read_record(stream) is not None:
        raise McapError(f"what lies before byte {position} is not what was written, and others follow it")
    # Its length may be damaged: other records may lie within the stated length.
    _refuse_whole_chunk_after(stream, start + _HEAD.size)


def _attachment_is_sound(record: bytes) -> bool:
    covered, crc = record[_HEAD.size : -_CRC_BYTES], record[-_CRC_BYTES:]
    return zlib.crc32(covered).to_bytes(_CRC_BYTES, "little") == crc


def _body(record: bytes) -> ReadDataStream:
    stream = BytesIO(record)
    stream.seek(_HEAD.size)
    return ReadDataStream(stream)
