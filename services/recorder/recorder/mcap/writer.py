"""One MCAP file: messages with their schemas, durable when asked.

Chunks of 1 MiB are packed with LZ4: measured signals shrink by nothing (they are noise in float64) and it costs them
no time, while pauses, constant drives and texts shrink well. zstd gains 4 % on such signals for a third of the speed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Final, cast

from google.protobuf.message import Message
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from duralab_recordings import BlockPlace
from recorder.mcap.schemas import describe_schema

CHUNK_BYTES: Final = 1024 * 1024
PROFILE: Final = "duralab"
_LARGEST_SEQUENCE: Final = 2**32


def sync_folder(folder: Path) -> None:
    """Make the names within a folder durable: fsync of a file alone does not keep its name through a power cut.

    `folder`: Of the files.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class _HashedStream:
    """A file that is written from its start to its end, with the hash of all its bytes."""

    def __init__(self, path: Path) -> None:
        # A buffered stream: on an unbuffered one the writer never writes its footer.
        self._file = path.open("xb")
        self._digest = hashlib.sha256()
        self._bytes = 0

    def write(self, data: bytes) -> int:
        self._file.write(data)
        self._digest.update(data)
        self._bytes += len(data)
        return len(data)

    def tell(self) -> int:
        return self._bytes

    def flush(self) -> None:
        self._file.flush()

    def sync(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()

    @property
    def closed(self) -> bool:
        return self._file.closed

    @property
    def sha256(self) -> str:
        return self._digest.hexdigest()


class McapLog:
    """A new MCAP file, open for writing.

    Parameters
    ----------
    path : Path
        Where it goes; nothing may be there yet.

    Raises
    ------
    FileExistsError
        Something is there already; it stays as it is.
    OSError
        It cannot be created; nothing is left behind.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stream = _HashedStream(path)
        try:
            self._writer = Writer(
                # It writes as a file does, and nothing else is asked of it.
                cast("IO[bytes]", self._stream),
                chunk_size=CHUNK_BYTES,
                compression=CompressionType.LZ4,
                # Over everything before the index: what lies between the chunks has no checksum of its own.
                enable_data_crcs=True,
            )
            self._writer.start(profile=PROFILE)
            self._stream.sync()
            sync_folder(path.parent)
        except BaseException:
            with contextlib.suppress(OSError):
                self._stream.close()
            path.unlink(missing_ok=True)
            raise
        self._schemas: dict[tuple[str, bool], int] = {}
        self._channels: dict[tuple[str, bool, str], int] = {}
        # Messages of each channel in the chunk that is being filled, and the chunks that are written.
        self._filling: Counter[int] = Counter()
        self._chunks: dict[int, list[BlockPlace]] = {}
        self._unsynced = False
        self._synced_bytes = self._stream.tell()

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self._path

    @property
    def bytes_written(self) -> int:
        """Size of the file so far, without the chunk being filled."""
        return self._stream.tell()

    @property
    def synced_bytes(self) -> int:
        """How much from its start on is known to be on the disk."""
        return self._synced_bytes

    @property
    def sha256(self) -> str:
        """SHA-256 (hexadecimal) of what was written so far, without the chunk being filled."""
        return self._stream.sha256

    def add_message(
        self,
        topic: str,
        data: bytes,
        *,
        kind: type[Message],
        sequence: int,
        metadata: Mapping[str, str] | None = None,
        doubles: bool = False,
        publish_time: int | None = None,
    ) -> None:
        """Add a serialised message.

        Parameters
        ----------
        topic : str
            Its topic.
        data : bytes
            The message.
        kind : type
            Of the message; its schema is written once.
        sequence : int
            Its number within the topic, 0 or more; MCAP keeps the lower 32 bits.
        metadata : mapping of str to str, optional
            Of the channel; messages of one topic with other metadata go to a channel of their own.
        doubles : bool
            Whether its arrays hold doubles only; see `describe_schema`.
        publish_time : int, optional
            Time of its first sample, in nanoseconds since 1970 UTC; now where not given, as always for the log time.
        """
        now = time.time_ns()
        channel = self._channel(topic, kind, metadata or {}, doubles=doubles)
        self._filling[channel] += 1
        before = self._stream.tell()
        self._writer.add_message(
            channel_id=channel,
            log_time=now,
            publish_time=now if publish_time is None else publish_time,
            sequence=sequence % _LARGEST_SEQUENCE,
            data=data,
        )
        self._note_chunk(before)
        self._unsynced = True

    def _note_chunk(self, before: int) -> None:
        """Note which channels have messages in the chunk that was written at `before`, if one was."""
        if self._stream.tell() == before or not self._filling:
            return
        for channel, count in self._filling.items():
            self._chunks.setdefault(channel, []).append(BlockPlace(self._path, before, channel, count))
        self._filling.clear()

    def places(self, topic: str, *, metadata: Mapping[str, str]) -> list[BlockPlace]:
        """Return the chunks that hold the messages of a topic, in order; those that are not synced are left out.

        Parameters
        ----------
        topic : str
            Of the messages.
        metadata : mapping of str to str
            Of their channel.
        """
        channels = [self._channels.get(_channel_key(topic, metadata, doubles=doubles)) for doubles in (False, True)]
        return [place for channel in channels if channel is not None for place in self._chunks.get(channel, [])]

    def _channel(self, topic: str, kind: type[Message], metadata: Mapping[str, str], *, doubles: bool) -> int:
        key = _channel_key(topic, metadata, doubles=doubles)
        channel = self._channels.get(key)
        if channel is None:
            before = self._stream.tell()
            schema = self._schema(kind, doubles=doubles)
            channel = self._writer.register_channel(topic, MessageEncoding.Protobuf, schema, dict(metadata))
            self._note_chunk(before)
            self._channels[key] = channel
        return channel

    def _schema(self, kind: type[Message], *, doubles: bool) -> int:
        name = kind.DESCRIPTOR.full_name
        if (name, doubles) not in self._schemas:
            data = describe_schema(kind, doubles=doubles)
            self._schemas[name, doubles] = self._writer.register_schema(name, SchemaEncoding.Protobuf, data)
        return self._schemas[name, doubles]

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add a named set of texts."""
        self._writer.add_metadata(name, dict(entries))
        self._unsynced = True

    def sync(self) -> None:
        """Return when all that was added is on the disk."""
        if not self._unsynced:
            return
        before = self._stream.tell()
        self._writer.flush()
        self._note_chunk(before)
        self._stream.sync()
        self._synced_bytes = self._stream.tell()
        self._unsynced = False

    def close(self) -> None:
        """Write the index and the footer and close the file; a closed file stays as it is."""
        if self._stream.closed:
            return
        try:
            self._writer.finish()
            self._stream.sync()
            self._synced_bytes = self._stream.tell()
        finally:
            self._stream.close()

    def release(self) -> None:
        """Let go of a file that cannot be written any more, without an end."""
        # What is still buffered cannot be written either: closing tries it once more, and fails again.
        with contextlib.suppress(OSError):
            self._stream.close()

    def abandon(self) -> None:
        """Let go of the file and remove it."""
        self.release()
        self._path.unlink(missing_ok=True)


def _channel_key(topic: str, metadata: Mapping[str, str], *, doubles: bool) -> tuple[str, bool, str]:
    return topic, doubles, repr(sorted(metadata.items()))
