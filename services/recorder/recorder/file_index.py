"""The index of a recording's file, and its chunks read through it: nothing else of a file is read than what counts."""

from __future__ import annotations

import struct
from collections.abc import Collection
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

from recorder.mcap_scan import is_finished, scan

_RECORD_HEAD: Final = struct.Struct("<BQ")
# Of a message index: kind, length of the rest, channel and the length of its entries, 16 bytes each.
_INDEX_HEAD: Final = struct.Struct("<BQHI")
_INDEX_ENTRY_BYTES: Final = 16


def index_of(path: Path) -> Summary:
    """Return the index of a file; one without an end is read from its start for it, once as long as nothing is added.

    Parameters
    ----------
    path : Path
        Of the file.

    Returns
    -------
    Summary
        Its schemas, channels and chunks, as far as it is whole; empty where it says that it has none.

    Raises
    ------
    McapError
        It is damaged; one of the other exceptions of `DAMAGE` may come as well.
    """
    status = path.stat()
    return _index(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=16)
def _index(path: Path, size: int, changed: int) -> Summary:
    del size, changed  # They are the cache's key: another file of that name has others.
    if is_finished(path):
        with path.open("rb") as stream:
            return SeekingReader(stream).get_summary() or Summary()
    found = scan(path, lambda _: None)
    summary = Summary()
    summary.schemas, summary.channels, summary.chunk_indexes = found.schemas, found.channels, found.chunks
    return summary


def forget_indexes() -> None:
    """Read every index again, as a process that has just begun does."""
    _index.cache_clear()


def count_messages(stream: IO[bytes], chunk: ChunkIndex, channel: int) -> int:
    """Return how many messages of a channel a chunk holds; the chunk itself is not read.

    Parameters
    ----------
    stream : file
        The chunk's file, open for reading.
    chunk : ChunkIndex
        Where the chunk is.
    channel : int
        One of its channels.

    Returns
    -------
    int
        As many as the chunk's message index has entries.

    Raises
    ------
    McapError
        There is no such message index where the file's index says.
    """
    offset = chunk.message_index_offsets[channel]
    stream.seek(offset)
    kind, length, found, entries = _INDEX_HEAD.unpack(stream.read(_INDEX_HEAD.size))
    rest = _INDEX_HEAD.size - _RECORD_HEAD.size
    if (kind, length, found) != (Opcode.MESSAGE_INDEX, rest + entries, channel):
        raise McapError(f"at byte {offset} is no message index of channel {channel}, though the file's index says so")
    return entries // _INDEX_ENTRY_BYTES


def messages_of(path: Path, chunk: ChunkIndex, channels: Collection[int]) -> list[Message]:
    """Read the messages of some channels from a chunk, its checksum checked, in the order they were written.

    Parameters
    ----------
    path : Path
        The chunk's file.
    chunk : ChunkIndex
        Where the chunk is.
    channels : collection of int
        The channels wanted.

    Returns
    -------
    list of Message
        Theirs.

    Raises
    ------
    McapError
        The chunk is damaged; one of the other exceptions of `DAMAGE` may come as well.
    """
    with path.open("rb") as stream:
        stream.seek(chunk.chunk_start_offset + _RECORD_HEAD.size)
        records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    return [record for record in records if isinstance(record, Message) and record.channel_id in channels]


def last_metadata(path: Path, name: str) -> dict[str, str] | None:
    """Read the last metadata record of a name from a finished file; None where it has none.

    Parameters
    ----------
    path : Path
        Of the file.
    name : str
        Of the record.

    Raises
    ------
    McapError
        The file is damaged; one of the other exceptions of `DAMAGE` may come as well.
    """
    places = [place for place in index_of(path).metadata_indexes if place.name == name]
    if not places:
        return None
    with path.open("rb") as stream:
        stream.seek(places[-1].offset + _RECORD_HEAD.size)
        return dict(Metadata.read(ReadDataStream(stream)).metadata)
