"""Reading messages out of an MCAP file by their type: one at a time, and also from a file that was never finished."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final, TypeVar, cast

from google.protobuf.message import DecodeError, Message
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import McapReader, SeekingReader
from mcap.records import Channel, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from duralab.errors import InputError

MessageT = TypeVar("MessageT", bound=Message)

EPOCH: Final = "epoch"
"""Entry of a stream channel's metadata: the epoch of its publisher."""

MAGIC: Final = b"\x89MCAP0\r\n"

DAMAGE: Final = (McapError, DecodeError, struct.error, ValueError, LookupError, RuntimeError, ZstdError)
"""What reading a damaged file raises, in the container, its compression and its messages."""


def files_from(path: Path) -> list[Path]:
    """Return a recording's files: the one given, then `<name>.part02.mcap` and so on where there are any."""
    files = [path]
    while (following := path.with_name(f"{path.stem}.part{len(files) + 1:02d}{path.suffix}")).is_file():
        files.append(following)
    return files


def epoch_of(channel: Channel) -> int:
    """Return the epoch of a stream's publisher; 0 of a channel that is no stream's."""
    return int(channel.metadata.get(EPOCH, "0"))


class McapFile:
    """The MCAP files of protobuf messages that are one recording.

    Parameters
    ----------
    path : Path
        The first file; those that follow lie beside it.

    Raises
    ------
    InputError
        There is no such file, or it is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files = [_OneFile(file) for file in files_from(path)]

    @property
    def paths(self) -> list[Path]:
        """Its files, in order."""
        return [file.path for file in self._files]

    @property
    def whole(self) -> bool:
        """False where a file has no index at its end: its writer was killed, what was written is read in order."""
        return all(file.whole for file in self._files)

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield the messages of one type in the order they were written, one in memory at a time.

        Raises
        ------
        InputError
            A file is damaged at a message that is read.
        """
        for _, message in self.with_epochs(kind):
            yield message

    def with_epochs(self, kind: type[MessageT]) -> Iterator[tuple[int, MessageT]]:
        """Yield each message as `messages` does, after the epoch of its stream: a repeated run has several."""
        for file in self._files:
            yield from file.with_epochs(kind)

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named sets of texts in the files, the last of each name; those of an unfinished one too."""
        found: dict[str, dict[str, str]] = {}
        for file in self._files:
            found |= file.metadata()
        return found


class _OneFile:
    """One MCAP file of protobuf messages; see `McapFile`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.whole = True
        with self._opened() as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path} does not start as an MCAP file and is no recording; give a recording.mcap.")
            stream.seek(0)
            try:
                summary = SeekingReader(stream).get_summary()
                self.whole = summary is not None and summary.statistics is not None
            except DAMAGE:
                # The reader that seeks refuses a file without an index; the one that streams does not need it.
                self.whole = False

    @contextmanager
    def _opened(self) -> Iterator[IO[bytes]]:
        try:
            stream = self.path.open("rb")
        except FileNotFoundError as error:
            raise InputError(f"There is no recording {str(self.path)!r}; give the path of an .mcap file.") from error
        except OSError as error:
            raise InputError(f"The recording {self.path} cannot be read: {error.strerror}.") from error
        with stream:
            yield stream

    def with_epochs(self, kind: type[MessageT]) -> Iterator[tuple[int, MessageT]]:
        """Yield the messages of one type; see `McapFile.with_epochs`."""
        name = kind.DESCRIPTOR.full_name
        with self._opened() as stream:
            try:
                found = self._indexed(stream, name) if self.whole else self._streamed(stream)
                for schema, channel, data in found:
                    if schema == name:
                        yield epoch_of(channel), cast("MessageT", kind.FromString(data))
            except DAMAGE as error:
                raise self._damaged(error) from error

    def _indexed(self, stream: IO[bytes], schema_name: str) -> Iterator[tuple[str, Channel, bytes]]:
        reader: McapReader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None:
            return
        wanted = {schema.id for schema in summary.schemas.values() if schema.name == schema_name}
        topics = sorted({channel.topic for channel in summary.channels.values() if channel.schema_id in wanted})
        if not topics:
            return
        for schema, channel, message in reader.iter_messages(topics=topics, log_time_order=False):
            if schema is not None:
                yield schema.name, channel, message.data

    @staticmethod
    def _streamed(stream: IO[bytes]) -> Iterator[tuple[str, Channel, bytes]]:
        schemas: dict[int, str] = {}
        channels: dict[int, Channel] = {}
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                match record:
                    case Schema():
                        schemas[record.id] = record.name
                    case Channel():
                        channels[record.id] = record
                    case McapMessage() if record.channel_id in channels:
                        channel = channels[record.channel_id]
                        yield schemas.get(channel.schema_id, ""), channel, record.data
        except EndOfFile:
            # The chunk being written when its writer was killed; all before it is whole.
            return

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named sets of texts; see `McapFile.metadata`."""
        with self._opened() as stream:
            try:
                if self.whole:
                    return {entry.name: dict(entry.metadata) for entry in SeekingReader(stream).iter_metadata()}
                return {
                    record.name: dict(record.metadata)
                    for record in _until_end(StreamReader(stream))
                    if isinstance(record, Metadata)
                }
            except DAMAGE as error:
                raise self._damaged(error) from error

    def _damaged(self, error: Exception) -> InputError:
        reason = str(error).rstrip(".") or type(error).__name__
        return InputError(f"The recording {self.path} is damaged ({reason}); `verify` of the recorder says where.")


def _until_end(reader: StreamReader) -> Iterator[object]:
    try:
        yield from reader.records
    except EndOfFile:
        return
