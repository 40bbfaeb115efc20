"""Reading messages out of an MCAP file by their type: one at a time, and also from a file that was never finished."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final, TypeVar, cast

from google.protobuf.message import Message
from mcap.reader import McapReader, SeekingReader
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.records import Message as McapMessage

from duralab.errors import InputError
from duralab.near_files import did_you_mean
from duralab.recording.damage import DAMAGE, damaged, unreadable
from duralab.recording.mcap_index import MAGIC, has_index, require_chunks, require_metadata
from duralab.recording.parts import Part, files_of, require_chain
from duralab.recording.unfinished import end_of_whole_records, whole_records
from strict_yaml import open_regular

MessageT = TypeVar("MessageT", bound=Message)

EPOCH: Final = "epoch"
"""Entry of a stream channel's metadata: the epoch of its publisher."""

_PART: Final = "part"
SUMMARY: Final = "summary"
"""Named sets of texts of a recorder's file: which part it is, at its start, and what it goes on in, at its end."""


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
        There is no such file, it is no MCAP file, its index is damaged, or the files are not one whole chain.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # The first one is opened before others are looked for: a name that no file can have is said as such.
        first = _OneFile(path)
        self._files = [first, *(_OneFile(file) for file in files_of(path)[1:])]
        require_chain([file.part for file in self._files])

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

        Parameters
        ----------
        kind : type
            Type of the messages.

        Yields
        ------
        MessageT
            The messages.

        Raises
        ------
        InputError
            A file is damaged at a message that is read.
        """
        for _, message in self.with_epochs(kind):
            yield message

    def with_epochs(self, kind: type[MessageT]) -> Iterator[tuple[int, MessageT]]:
        """Yield each message as `messages` does, after the epoch of its stream: a repeated run has several.

        Parameters
        ----------
        kind : type
            Type of the messages.

        Yields
        ------
        tuple[int, MessageT]
            Epoch and message.
        """
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
        with self._opened() as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path} does not start as an MCAP file and is no recording; give a recording.mcap.")
            try:
                self.whole = self._has_statistics(stream)
                self.part = self._part(stream)
            except DAMAGE as error:
                raise damaged(path, error) from error

    def _has_statistics(self, stream: IO[bytes]) -> bool:
        if not has_index(self.path, stream):
            return False
        stream.seek(0)
        summary = SeekingReader(stream).get_summary()
        return summary is not None and summary.statistics is not None

    def _part(self, stream: IO[bytes]) -> Part:
        """Return what the file says of its place; one that was never finished says at its start which part it is."""
        stream.seek(0)
        is_empty = False
        if self.whole:
            texts = {entry.name: entry.metadata for entry in _metadata(stream)}
        else:
            if end_of_whole_records(stream) == len(MAGIC):
                raise InputError(f"{self.path} ends within its first record and holds nothing; give a recording.mcap.")
            texts, is_empty = {}, True
            for record in whole_records(stream, emit_chunks=True):
                if isinstance(record, Chunk | McapMessage) or _PART in texts:
                    is_empty = False
                    break
                if isinstance(record, Metadata):
                    texts[record.name] = record.metadata
        said = texts.get(_PART, {})
        return Part(
            path=self.path,
            recording=said.get("recording", ""),
            number=int(said.get("number", "0")),
            next_file=texts.get(SUMMARY, {}).get("next_file", ""),
            is_empty=is_empty and _PART not in texts,
        )

    @contextmanager
    def _opened(self) -> Iterator[IO[bytes]]:
        try:
            stream = open_regular(self.path)
        except (FileNotFoundError, ValueError) as error:
            # ValueError: no name on this system, for it holds a zero byte.
            guess = did_you_mean(self.path)
            raise InputError(
                f"There is no recording {str(self.path)!r}; give the path of an .mcap file{guess}"
            ) from error
        except IsADirectoryError as error:
            raise InputError(f"{str(self.path)!r} is a folder; give the path of an .mcap file.") from error
        except OSError as error:
            raise unreadable(self.path, error) from error
        with stream:
            try:
                yield stream
            except OSError as error:
                raise unreadable(self.path, error) from error

    def with_epochs(self, kind: type[MessageT]) -> Iterator[tuple[int, MessageT]]:
        """Yield the messages of one type; see `McapFile.with_epochs`."""
        name = kind.DESCRIPTOR.full_name
        with self._opened() as stream:
            try:
                found = self._indexed(stream, name) if self.whole else _streamed(stream)
                for schema, channel, data in found:
                    if schema == name:
                        yield epoch_of(channel), cast("MessageT", kind.FromString(data))
            except DAMAGE as error:
                raise damaged(self.path, error) from error

    def _indexed(self, stream: IO[bytes], schema_name: str) -> Iterator[tuple[str, Channel, bytes]]:
        reader: McapReader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None:
            return
        wanted = {schema.id for schema in summary.schemas.values() if schema.name == schema_name}
        topics = sorted({channel.topic for channel in summary.channels.values() if channel.schema_id in wanted})
        if not topics:
            return
        channels = {channel.id for channel in summary.channels.values() if channel.schema_id in wanted}
        # A chunk that is not read may be damaged without harm to those that are.
        require_chunks(stream, [each for each in summary.chunk_indexes if each.message_index_offsets.keys() & channels])
        for schema, channel, message in reader.iter_messages(topics=topics, log_time_order=False):
            if schema is not None:
                yield schema.name, channel, message.data

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named sets of texts; see `McapFile.metadata`."""
        with self._opened() as stream:
            try:
                records = _metadata(stream) if self.whole else whole_records(stream)
                return {record.name: dict(record.metadata) for record in records if isinstance(record, Metadata)}
            except DAMAGE as error:
                raise damaged(self.path, error) from error


def _metadata(stream: IO[bytes]) -> Iterator[Metadata]:
    reader = SeekingReader(stream)
    summary = reader.get_summary()
    require_metadata(stream, () if summary is None else summary.metadata_indexes)
    yield from reader.iter_metadata()


def _streamed(stream: IO[bytes]) -> Iterator[tuple[str, Channel, bytes]]:
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in whole_records(stream):
        match record:
            case Schema():
                schemas[record.id] = record.name
            case Channel():
                channels[record.id] = record
            case McapMessage() if record.channel_id in channels:
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id, ""), channel, record.data
            case _:
                pass
