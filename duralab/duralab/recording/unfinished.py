"""The whole records of an MCAP file that was never finished: its writer was killed in the middle of one."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from typing import IO, Final, cast

from mcap.exceptions import EndOfFile, McapError
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader

from duralab.recording.mcap_index import MAGIC

_HEAD: Final = struct.Struct("<BQ")
_LARGEST_RECORD: Final = 5 * 2**28
"""Bytes of a record, 1.25 GiB: the bus carries messages of 1 GiB at most. A larger one is no record but damage, which
the reader then names."""

_BLOCK_BYTES: Final = 1024 * 1024


class _UpTo:
    """A file that ends where its last whole record does."""

    def __init__(self, stream: IO[bytes], end: int) -> None:
        self._stream = stream
        self._end = end

    def read(self, length: int) -> bytes:
        return self._stream.read(min(length, self._end - self._stream.tell()))

    @property
    def exhausted(self) -> bool:
        return self._stream.tell() >= self._end


def end_of_whole_records(stream: IO[bytes]) -> int:
    """Return the position after the last record that is there with all its bytes.

    Zeros up to the end of the file are none: a power cut leaves them where data was to come.

    Raises
    ------
    McapError
        Zeros stand where a record was to come, and other bytes follow them.
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
        if length > _LARGEST_RECORD:
            return size
        if end + _HEAD.size + length > size:
            break
        end += _HEAD.size + length
    return end


def _zeros_end(stream: IO[bytes], start: int) -> int:
    """Return the position of the first byte from `start` that is not zero, or the end of the file.

    What a sparse file does not store is not read.
    """
    position = start
    while (data := _next_data(stream, position)) is not None:
        position = data
        stream.seek(position)
        block = stream.read(_BLOCK_BYTES)
        if rest := block.lstrip(b"\0"):
            return position + len(block) - len(rest)
        position += len(block)
    return stream.seek(0, os.SEEK_END)


def _next_data(stream: IO[bytes], start: int) -> int | None:
    """Return the position of the next stored byte from `start` on; None where only a hole follows."""
    descriptor = stream.fileno()
    # The stream's buffer counts on where its descriptor stands.
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        return os.lseek(descriptor, start, os.SEEK_DATA)
    except OSError as error:
        if error.errno == errno.ENXIO:
            return None
        raise
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)


def whole_records(stream: IO[bytes], *, emit_chunks: bool = False) -> Iterator[McapRecord]:
    """Yield the records up to the last whole one; raises one of DAMAGE where one of them is damaged.

    Parameters
    ----------
    stream : IO of bytes
        The file.
    emit_chunks : bool
        Yield chunks as they are, not the records in them.
    """
    cut = _UpTo(stream, end_of_whole_records(stream))
    stream.seek(0)
    # It is read, and nothing else is asked of it.
    reader = StreamReader(
        cast("IO[bytes]", cut), emit_chunks=emit_chunks, validate_crcs=True, record_size_limit=_LARGEST_RECORD
    )
    try:
        yield from reader.records
    except EndOfFile:
        # The record being written when its writer was killed; all before it is whole.
        if not cut.exhausted:
            raise
