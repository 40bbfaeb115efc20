"""The whole records of an MCAP file that was never finished: its writer was killed in the middle of one."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from typing import IO, Final, cast

from mcap.exceptions import EndOfFile
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader

from duralab.mcap_index import MAGIC

_HEAD: Final = struct.Struct("<BQ")
_LARGEST_RECORD: Final = 4 * 2**30
"""As the reader's own limit: a larger one is no record but damage, which the reader then names."""


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
    """Return the position after the last record that is there with all its bytes."""
    size = stream.seek(0, os.SEEK_END)
    end = len(MAGIC)
    while end + _HEAD.size <= size:
        stream.seek(end)
        _, length = _HEAD.unpack(stream.read(_HEAD.size))
        if length > _LARGEST_RECORD:
            return size
        if end + _HEAD.size + length > size:
            break
        end += _HEAD.size + length
    return end


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
    reader = StreamReader(cast("IO[bytes]", cut), emit_chunks=emit_chunks, validate_crcs=True)
    try:
        yield from reader.records
    except EndOfFile:
        # The record being written when its writer was killed; all before it is whole.
        if not cut.exhausted:
            raise
