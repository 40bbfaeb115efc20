"""Index of a recording's file, and its chunks read through it: only the needed parts of a file are read."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator
from functools import lru_cache
from pathlib import Path
from typing import IO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex, Message, Metadata
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from duralab_recordings.unfinished import FOOTER_BYTES, LARGEST_RECORD, MAGIC, scan

_RECORD_HEAD: Final = struct.Struct("<BQ")
# Opcode and length, then the positions of the index and its offsets; the checksum follows.
_FOOTER: Final = struct.Struct("<BQQQI")
_CRC_BYTES: Final = 4
_BLOCK_BYTES: Final = 1024 * 1024
# Head of a message index: kind, length of the rest, channel and the length of its entries, 16 bytes each.
_INDEX_HEAD: Final = struct.Struct("<BQHI")
_INDEX_ENTRY_BYTES: Final = 16
# Start of a chunk: its head, first and last time, and size.
_CHUNK: Final = struct.Struct("<BQQQQ")
_LARGEST_IN_INDEX: Final = 64 * 1024 * 1024
"""Largest record of the index in bytes: those of a schema and of a chunk with thousands of channels are far smaller."""


def index_of(path: Path) -> Summary:
    """Return the index of a file; for a file without an end it is made by a scan, and kept until the file changes.

    Parameters
    ----------
    path : Path
        Path of the file.

    Returns
    -------
    Summary
        Its schemas, channels and chunks, as far as the file is intact.

    Raises
    ------
    McapError
        If the file is damaged; other exceptions of `DAMAGE` are possible as well.
    """
    status = path.stat()
    return _index(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=16)
def _index(path: Path, size: int, changed: int) -> Summary:
    del size, changed  # Key of the cache: another file of that name has other values.
    with path.open("rb") as stream:
        if index_start(stream):
            return index_reader(stream).get_summary() or Summary()
    found = scan(path, lambda _: None)
    summary = Summary()
    summary.schemas, summary.channels, summary.chunk_indexes = found.schemas, found.channels, found.chunks
    return summary


def index_start(stream: IO[bytes]) -> int | None:
    """Return the position of a file's index, after a check of its checksum and its records.

    A flipped bit in the index would hide whole chunks. Zeros, which a failing disk leaves, would be stepped through
    nine bytes at a time.
    """
    size = stream.seek(0, os.SEEK_END)
    footer = size - len(MAGIC) - _FOOTER.size
    if footer < len(MAGIC):
        return None
    stream.seek(footer)
    opcode, length, start, _, checksum = _FOOTER.unpack(stream.read(_FOOTER.size))
    is_footer = (opcode, length) == (Opcode.FOOTER, FOOTER_BYTES) and start <= footer
    # Without an index the checksum covers the footer alone; 0 means that no checksum was computed.
    covered = range(start or footer, footer + _FOOTER.size - _CRC_BYTES)
    is_sound = is_footer and (checksum == 0 or _checksum(stream, covered) == checksum)
    stream.seek(footer + _FOOTER.size)
    if stream.read(len(MAGIC)) != MAGIC:
        if is_sound and checksum != 0:
            raise McapError("its last eight bytes are not those of an MCAP file")
        return None
    if not is_footer:
        raise McapError("the footer, which locates the index, is not valid")
    position = start or footer
    while position < footer:
        kind, length = _head(stream, position)
        if kind == 0 or length > min(_LARGEST_IN_INDEX, footer - position - _RECORD_HEAD.size):
            raise McapError(f"no record of its index begins at byte {position}")
        position += _RECORD_HEAD.size + length
    if not is_sound:
        raise McapError("the index at its end differs from its checksum")
    return start


def index_reader(stream: IO[bytes]) -> SeekingReader:
    """Return a reader of a finished file, after a check of its index and of the positions of its metadata.

    Parameters
    ----------
    stream : file
        Finished file, open for reading.

    Returns
    -------
    SeekingReader
        Reader at the beginning of the file.

    Raises
    ------
    McapError
        If the file has no index or a damaged one; other exceptions of `DAMAGE` are possible as well.
    """
    if not index_start(stream):
        # The reader would search for messages and metadata from the start of the file.
        raise McapError("it has no index")
    stream.seek(0)
    reader = SeekingReader(stream, validate_crcs=True, record_size_limit=LARGEST_RECORD)
    summary = reader.get_summary()
    if summary is None:
        raise McapError("it has no index")
    for place in summary.metadata_indexes:
        if _head(stream, place.offset)[0] != Opcode.METADATA:
            raise McapError(f"at byte {place.offset} is not the metadata {place.name!r} that its index names")
    return reader


def expect_chunk(stream: IO[bytes], chunk: ChunkIndex) -> None:
    """Check that a chunk begins at the position in its file's index, and has the properties stated there.

    Zeros, which a failing disk leaves, read as a chunk without messages.

    Parameters
    ----------
    stream : file
        Finished file, open for reading.
    chunk : ChunkIndex
        Entry of its index.

    Raises
    ------
    McapError
        If another record begins there, or none.
    """
    stream.seek(chunk.chunk_start_offset)
    content = stream.read(_CHUNK.size)
    said = (Opcode.CHUNK, chunk.chunk_length - _RECORD_HEAD.size, chunk.message_start_time, chunk.message_end_time)
    if len(content) < _CHUNK.size or _CHUNK.unpack(content) != (*said, chunk.uncompressed_size):
        raise McapError(f"at byte {chunk.chunk_start_offset} is not the chunk that its index names")


def _head(stream: IO[bytes], position: int) -> tuple[int, int]:
    """Return kind and length of a record."""
    stream.seek(position)
    return _RECORD_HEAD.unpack(stream.read(_RECORD_HEAD.size))


def _checksum(stream: IO[bytes], covered: range) -> int:
    found = 0
    stream.seek(covered.start)
    for first in range(covered.start, covered.stop, _BLOCK_BYTES):
        found = zlib.crc32(stream.read(min(_BLOCK_BYTES, covered.stop - first)), found)
    return found


def forget_indexes() -> None:
    """Empty the cache of indexes, so that every index is read again, as in a new process."""
    _index.cache_clear()


def count_messages(stream: IO[bytes], chunk: ChunkIndex, channel: int) -> int:
    """Return the number of messages of a channel in a chunk; the chunk itself is not read.

    Parameters
    ----------
    stream : file
        File of the chunk, open for reading.
    chunk : ChunkIndex
        Index entry of the chunk.
    channel : int
        Number of one of its channels.

    Returns
    -------
    int
        Number of entries of the chunk's message index.

    Raises
    ------
    McapError
        If there is no such message index at the position in the file's index.
    """
    offset = chunk.message_index_offsets[channel]
    stream.seek(offset)
    kind, length, found, entries = _INDEX_HEAD.unpack(stream.read(_INDEX_HEAD.size))
    rest = _INDEX_HEAD.size - _RECORD_HEAD.size
    if (kind, length, found) != (Opcode.MESSAGE_INDEX, rest + entries, channel):
        raise McapError(
            f"at byte {offset} is no message index of channel {channel}, though the file's index reports it"
        )
    return entries // _INDEX_ENTRY_BYTES


def messages_at(stream: IO[bytes], offset: int, channels: Collection[int]) -> list[Message]:
    """Read the messages of some channels from the chunk at a byte, with a check of its checksum, as written."""
    if _head(stream, offset)[0] != Opcode.CHUNK:
        raise McapError(f"at byte {offset} is not the chunk that was written there")
    records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    return [record for record in records if isinstance(record, Message) and record.channel_id in channels]


def messages_of(path: Path, chunk: ChunkIndex, channels: Collection[int]) -> list[Message]:
    """Read the messages of some channels from a chunk in an index; as `messages_at`.

    Parameters
    ----------
    path : Path
        File of the chunk.
    chunk : ChunkIndex
        Index entry of the chunk.
    channels : collection of int
        Numbers of the channels.

    Returns
    -------
    list of Message
        Messages of these channels.

    Raises
    ------
    McapError
        If the chunk is damaged or differs from its index.
    """
    with path.open("rb") as stream:
        expect_chunk(stream, chunk)
        return messages_at(stream, chunk.chunk_start_offset, channels)


def messages_on(path: Path, topic: str) -> Iterator[Message]:
    """Yield the messages of a topic from a finished file, in the order they were written.

    Parameters
    ----------
    path : Path
        Path of the file.
    topic : str
        Topic of the messages.

    Yields
    ------
    Message
        Message as stored.

    Raises
    ------
    McapError
        As for `messages_of`.
    """
    summary = index_of(path)
    wanted = {number for number, channel in summary.channels.items() if channel.topic == topic}
    for chunk in summary.chunk_indexes:
        if chunk.message_index_offsets.keys() & wanted:
            yield from messages_of(path, chunk, wanted)


def last_metadata(path: Path, name: str) -> dict[str, str] | None:
    """Read the last metadata record of a name from a finished file; None if it has none.

    Parameters
    ----------
    path : Path
        Path of the file.
    name : str
        Name of the record.

    Returns
    -------
    dict of str to str, or None
        Content of the record.

    Raises
    ------
    McapError
        If the file is damaged; other exceptions of `DAMAGE` are possible as well.
    """
    places = [place for place in index_of(path).metadata_indexes if place.name == name]
    if not places:
        return None
    with path.open("rb") as stream:
        stream.seek(places[-1].offset + _RECORD_HEAD.size)
        return dict(Metadata.read(ReadDataStream(stream)).metadata)
