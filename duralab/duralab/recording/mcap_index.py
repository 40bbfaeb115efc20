"""The index at the end of an MCAP file: whether there is one, and whether it is what its writer wrote."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MetadataIndex

from duralab.recording.damage import damaged

MAGIC: Final = b"\x89MCAP0\r\n"

# Opcode and length, then where the index and its offsets start; the checksum follows.
_FOOTER: Final = struct.Struct("<BQQQI")
_FOOTER_LENGTH: Final = 20
_HEAD: Final = struct.Struct("<BQ")
# Of a chunk: its head, first and last time, size and checksum.
_CHUNK: Final = struct.Struct("<BQQQQI")
_LARGEST_IN_INDEX: Final = 64 * 1024 * 1024
"""Bytes of a record of the index: those of a schema and of a chunk with thousands of channels are far smaller."""
_CRC_BYTES: Final = 4
_BLOCK_BYTES: Final = 1024 * 1024


def has_index(path: Path, stream: IO[bytes]) -> bool:
    """Return whether a file was finished with an index, after a look at the checksum over it.

    A flipped bit in the index would take whole chunks out of the recording without a word.

    Parameters
    ----------
    path : Path
        The file, for what is said.
    stream : IO of bytes
        Its content.

    Returns
    -------
    bool
        False where it was never finished, or finished without an index.

    Raises
    ------
    InputError
        It was finished, and its end is damaged.
    """
    size = stream.seek(0, os.SEEK_END)
    start_of_footer = size - len(MAGIC) - _FOOTER.size
    if start_of_footer < len(MAGIC):
        return False
    stream.seek(start_of_footer)
    opcode, length, index_start, _, checksum = _FOOTER.unpack(stream.read(_FOOTER.size))
    is_footer = (opcode, length) == (Opcode.FOOTER, _FOOTER_LENGTH) and index_start <= start_of_footer
    # Without an index the checksum is over the footer alone; where it is 0, none was worked out.
    covered = range(index_start or start_of_footer, start_of_footer + _FOOTER.size - _CRC_BYTES)
    is_sound = is_footer and (checksum == 0 or _checksum(stream, covered) == checksum)
    stream.seek(start_of_footer + _FOOTER.size)
    if stream.read(len(MAGIC)) != MAGIC:
        if is_sound and checksum != 0:
            raise damaged(path, "its last eight bytes are not those of an MCAP file")
        return False
    if not is_footer:
        raise damaged(path, "the footer, which says where its index is, is none")
    if not is_sound:
        raise damaged(path, "the index at its end differs from its checksum")
    if index_start > 0:
        _require_records(path, stream, range(index_start, start_of_footer))
    return index_start > 0


def require_chunks(stream: IO[bytes], chunks: Iterable[ChunkIndex]) -> None:
    """Check that chunks begin where the index says and as it says; raises McapError.

    Zeros read as an empty chunk: where a disk lost them, messages would be missing without a word.
    """
    for chunk in chunks:
        stream.seek(chunk.chunk_start_offset)
        content = stream.read(_CHUNK.size)
        said = (Opcode.CHUNK, chunk.chunk_length - _HEAD.size, chunk.message_start_time, chunk.message_end_time)
        if len(content) < _CHUNK.size or _CHUNK.unpack(content)[:5] != (*said, chunk.uncompressed_size):
            raise McapError(f"at byte {chunk.chunk_start_offset} is not the chunk that its index names")


def require_metadata(stream: IO[bytes], places: Iterable[MetadataIndex]) -> None:
    """Check that metadata begin where the index says; raises McapError. A reader would look for them through zeros."""
    for place in places:
        stream.seek(place.offset)
        if stream.read(1) != bytes([Opcode.METADATA]):
            raise McapError(f"at byte {place.offset} is not the metadata {place.name!r} that its index names")


def _require_records(path: Path, stream: IO[bytes], covered: range) -> None:
    """Refuse an index that is not record after record: a reader would step through zeros nine bytes at a time."""
    position = covered.start
    while position < covered.stop:
        stream.seek(position)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        if opcode == 0 or length > _LARGEST_IN_INDEX or position + _HEAD.size + length > covered.stop:
            raise damaged(path, f"no record of its index begins at byte {position}")
        position += _HEAD.size + length


def _checksum(stream: IO[bytes], covered: range) -> int:
    found = 0
    stream.seek(covered.start)
    for first in range(covered.start, covered.stop, _BLOCK_BYTES):
        found = zlib.crc32(stream.read(min(_BLOCK_BYTES, covered.stop - first)), found)
    return found
