"""Files that were never finished: how far each is whole, and the ending that makes it a complete MCAP file.

A recorder that is killed leaves a file that stops somewhere. Everything before is whole and has its checksums; the
ending (index, statistics, footer) is made again from what is there, so nothing that was written is written twice.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Final

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk

from recorder.mcap_damage import DAMAGE

MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")
_CHUNK_KIND: Final = bytes([Opcode.CHUNK])
# Its two times, size, checksum, name of the compression and size of the records.
_SMALLEST_CHUNK: Final = 40
_FOOTER_START: Final = struct.Struct("<BQQQ")
_FOOTER_BYTES: Final = 20
_CRC_BYTES: Final = 4

Take = Callable[[McapRecord], None]
"""Called with each schema, channel, message, metadata and attachment, in order."""


@dataclass
class Unfinished:
    """What is whole in a file without an end.

    Parameters
    ----------
    end : int
        Where it ends: what follows was being written and is no part of it.
    crc : int
        CRC-32 of everything before.
    """

    end: int = 0
    crc: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    message_counts: dict[int, int] = field(default_factory=dict)


def is_finished(path: Path) -> bool:
    """Tell whether a file ends as a complete MCAP file does; nothing else of it is checked."""
    least = 2 * len(MAGIC) + _HEAD.size + _FOOTER_BYTES
    with path.open("rb") as stream:
        if stream.seek(0, os.SEEK_END) < least:
            return False
        stream.seek(-len(MAGIC) - _FOOTER_BYTES - _HEAD.size, os.SEEK_END)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        return (opcode, length) == (Opcode.FOOTER, _FOOTER_BYTES) and stream.read()[-len(MAGIC) :] == MAGIC


def check_begin(path: Path) -> None:
    """Raise InvalidMagic where a file begins otherwise than an MCAP file, be it as short as it may."""
    with path.open("rb") as stream:
        begin = stream.read(len(MAGIC))
    if not MAGIC.startswith(begin):
        raise InvalidMagic(begin)


def scan(path: Path, take: Take) -> Unfinished:
    """Read a file from its start as far as it is whole, with all checksums, one record in memory at a time.

    Parameters
    ----------
    path : Path
        A file that was written in chunks; where it has an ending, that is left out.
    take : callable
        Called with what is read; an error of its own ends the scan.

    Returns
    -------
    Unfinished
        With `end` 0 where it does not even begin as an MCAP file.

    Raises
    ------
    McapError
        It is damaged in its middle: what follows there is whole, so no kill ended it.
    """
    found = Unfinished()
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return found
        found.end, found.crc = len(MAGIC), zlib.crc32(MAGIC)
        while (group := _Group.read(stream, start=found.end)) is not None:
            group.note(found, take)
    return found


@dataclass
class _Group:
    """A record, or a chunk with the message indexes that belong to it: whole, or taken for not written."""

    start: int
    data: bytes
    opcode: int
    indexes: dict[int, tuple[int, int]] = field(default_factory=dict)
    inner: list[McapRecord] = field(default_factory=list)

    @staticmethod
    def read(stream: IO[bytes], *, start: int) -> _Group | None:
        record = _read_record(stream)
        if record is None or record[0] in (Opcode.DATA_END, Opcode.FOOTER):
            return None
        group = _Group(start=start, data=record[1], opcode=record[0])
        if group.opcode == Opcode.ATTACHMENT:
            return group if _attachment_is_sound(group.data) else _torn(stream)
        if group.opcode != Opcode.CHUNK:
            return group
        try:
            group.inner = breakup_chunk(Chunk.read(_body(group.data)), validate_crc=True)
        except (*DAMAGE, MemoryError):
            return _torn(stream)
        wanted = {record.channel_id for record in group.inner if isinstance(record, Message)}
        while wanted:
            record = _read_record(stream)
            if record is None or record[0] != Opcode.MESSAGE_INDEX:
                return None
            index = MessageIndex.read(_body(record[1]))
            group.indexes[index.channel_id] = (len(group.data), len(index.records))
            group.data += record[1]
            wanted.discard(index.channel_id)
        return group

    def note(self, found: Unfinished, take: Take) -> None:
        body = _body(self.data)
        match self.opcode:
            case Opcode.CHUNK:
                self._note_chunk(found, take, Chunk.read(body))
            case Opcode.METADATA:
                metadata = Metadata.read(body)
                found.metadata.append(MetadataIndex(offset=self.start, length=len(self.data), name=metadata.name))
                take(metadata)
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
                take(attachment)
        found.end = self.start + len(self.data)
        found.crc = zlib.crc32(self.data, found.crc)

    def _note_chunk(self, found: Unfinished, take: Take, chunk: Chunk) -> None:
        for record in self.inner:
            match record:
                case Schema():
                    found.schemas[record.id] = record
                case Channel():
                    found.channels[record.id] = record
            take(record)
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
    """Return the kind and all bytes of the next record, or None where it is not there as a whole."""
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    opcode, length = _HEAD.unpack(head)
    left = os.fstat(stream.fileno()).st_size - stream.tell()
    # A kind 0 is no record: a power cut may leave zeros where data was to come.
    if opcode == 0 or length > left:
        _refuse_whole_chunk_after(stream, stream.tell())
        return None
    return opcode, head + stream.read(length)


def _refuse_whole_chunk_after(stream: IO[bytes], position: int) -> None:
    """Raise McapError where a whole chunk follows: then a length before it is damaged, and it is not the file's end."""
    rest = stream.read()
    stream.seek(position)
    at = rest.find(_CHUNK_KIND)
    while at >= 0:
        length = int.from_bytes(rest[at + 1 : at + _HEAD.size], "little")
        end = at + _HEAD.size + length
        # Only then a copy: nearly every byte that looks like a chunk's beginning is none.
        if length > _SMALLEST_CHUNK and end <= len(rest) and _is_whole_chunk(rest[at:end]):
            raise McapError(f"the record before byte {position} has an impossible length, and others follow it")
        at = rest.find(_CHUNK_KIND, at + 1)


def _is_whole_chunk(record: bytes) -> bool:
    try:
        return bool(breakup_chunk(Chunk.read(_body(record)), validate_crc=True))
    except (*DAMAGE, MemoryError):
        return False


def _torn(stream: IO[bytes]) -> None:
    """Accept a last record whose content is not what was written, as a power cut leaves it; elsewhere it is damage."""
    position = stream.tell()
    if _read_record(stream) is not None:
        raise McapError(f"the record before byte {position} is not what was written, and others follow it")


def _attachment_is_sound(record: bytes) -> bool:
    covered, crc = record[_HEAD.size : -_CRC_BYTES], record[-_CRC_BYTES:]
    return zlib.crc32(covered).to_bytes(_CRC_BYTES, "little") == crc


def _body(record: bytes) -> ReadDataStream:
    stream = BytesIO(record)
    stream.seek(_HEAD.size)
    return ReadDataStream(stream)


def finish(path: Path, found: Unfinished, *, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Cut off what is not whole, write an ending in its place, and return when it is on the disk.

    Parameters
    ----------
    path : Path
        The file that was scanned.
    found : Unfinished
        What the scan found.
    metadata : mapping of str to mapping of str to str
        Put in before the ending.

    Raises
    ------
    OSError
        The disk refuses it; the file is left as it was found, without what was not whole.
    """
    with path.open("r+b") as stream:
        stream.truncate(found.end)
        stream.seek(found.end)
        try:
            stream.write(_ending(found, metadata))
            stream.flush()
            os.fsync(stream.fileno())
        except OSError:
            stream.truncate(found.end)
            raise


def _ending(found: Unfinished, metadata: Mapping[str, Mapping[str, str]]) -> bytes:
    builder = RecordBuilder()
    indexes = list(found.metadata)
    for name, entries in metadata.items():
        offset = builder.count
        Metadata(name=name, metadata=dict(entries)).write(builder)
        indexes.append(MetadataIndex(offset=found.end + offset, length=builder.count - offset, name=name))
    added = builder.end()
    DataEnd(zlib.crc32(added, found.crc)).write(builder)
    data = added + builder.end()
    start = found.end + len(data)
    summary = RecordBuilder()
    groups: list[SummaryOffset] = []
    for opcode, records in (
        (Opcode.SCHEMA, list(found.schemas.values())),
        (Opcode.CHANNEL, list(found.channels.values())),
        (Opcode.STATISTICS, [_statistics(found, metadata_count=len(indexes))]),
        (Opcode.CHUNK_INDEX, found.chunks),
        (Opcode.ATTACHMENT_INDEX, found.attachments),
        (Opcode.METADATA_INDEX, indexes),
    ):
        first = summary.count
        for record in records:
            record.write(summary)
        if records:
            groups.append(SummaryOffset(opcode, start + first, summary.count - first))
    offsets_start = start + summary.count
    for group in groups:
        group.write(summary)
    index = summary.end()
    covered = index + _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offsets_start)
    Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=zlib.crc32(covered)).write(builder)
    return data + index + builder.end() + MAGIC


def _statistics(found: Unfinished, *, metadata_count: int) -> Statistics:
    return Statistics(
        attachment_count=len(found.attachments),
        channel_count=len(found.channels),
        channel_message_counts=found.message_counts,
        chunk_count=len(found.chunks),
        message_count=sum(found.message_counts.values()),
        message_start_time=min((chunk.message_start_time for chunk in found.chunks), default=0),
        message_end_time=max((chunk.message_end_time for chunk in found.chunks), default=0),
        metadata_count=metadata_count,
        schema_count=len(found.schemas),
    )
