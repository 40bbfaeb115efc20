"""The ending that makes a file that was never finished a complete MCAP file.

Index, statistics and footer are made again from what is there, so nothing that was written is written twice.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Metadata, MetadataIndex, Statistics, SummaryOffset

from duralab_recordings import FOOTER_BYTES, MAGIC, Unfinished

_FOOTER_START: Final = struct.Struct("<BQQQ")


def finish(path: Path, found: Unfinished, *, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Cut off what is not whole, write an ending in its place, and return when it is on the disk.

    `path`: The file that was scanned. `found`: What the scan found. `metadata`: Put in before the ending.
    Raises `OSError`: The disk refuses it; the file is left as it was found, without what was not whole.
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
    covered = index + _FOOTER_START.pack(Opcode.FOOTER, FOOTER_BYTES, start, offsets_start)
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
