"""MCAP files: written, scanned, ended after a kill, read by their index."""

from recorder.mcap.damage import DAMAGE, reason_of
from recorder.mcap.ending import finish
from recorder.mcap.file_scan import MAGIC, RecordReader, Unfinished, ZerosError, check_begin, is_finished, scan
from recorder.mcap.index import (
    chunks_of,
    count_messages,
    expect_chunk,
    forget_indexes,
    index_of,
    index_reader,
    last_metadata,
    messages_of,
)
from recorder.mcap.schemas import holds_doubles_only
from recorder.mcap.writer import McapLog, sync_folder

__all__ = [
    "DAMAGE",
    "MAGIC",
    "McapLog",
    "RecordReader",
    "Unfinished",
    "ZerosError",
    "check_begin",
    "chunks_of",
    "count_messages",
    "expect_chunk",
    "finish",
    "forget_indexes",
    "holds_doubles_only",
    "index_of",
    "index_reader",
    "is_finished",
    "last_metadata",
    "messages_of",
    "reason_of",
    "scan",
    "sync_folder",
]
