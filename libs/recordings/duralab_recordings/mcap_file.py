"""Messages of a recording by their type: one at a time, and also from a file that was never finished."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final, TypeVar, cast

from google.protobuf.message import Message
from mcap.records import Channel, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.summary import Summary

from duralab_recordings.damage import DAMAGE, MissingFileError, RecordingError, damaged, unreadable
from duralab_recordings.index import expect_chunk, index_reader, index_start, messages_at
from duralab_recordings.parts import (
    PART_METADATA,
    SUMMARY_METADATA,
    Part,
    files_of,
    newer_format,
    open_end,
    require_chain,
)
from duralab_recordings.unfinished import MAGIC, RecordReader, end_of_records, whole_records
from duralab_settings import open_regular

MessageT = TypeVar("MessageT", bound=Message)

EPOCH: Final = "epoch"
"""Entry of a stream channel's metadata: the epoch of its publisher."""


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
    RecordingError
        There is no such file, it is no MCAP file or of a newer format, its index is damaged, or the files are not one
        whole chain.
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
        """Yield the messages of one type in the order they were written, one in memory at a time."""
        for file in self._files:
            yield from file.messages(kind)

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named sets of texts in the files, the last of each name; those of an unfinished one too."""
        found: dict[str, dict[str, str]] = {}
        for file in self._files:
            found |= file.metadata()
        return found

    def open_end(self) -> str:
        """Return in a clause that the last file is whole and the recording may go on in another; see `open_end`."""
        reason = self.metadata().get(SUMMARY_METADATA, {}).get("reason", "")
        return open_end(self.path, parts=len(self._files), reason=reason)


class _OneFile:
    """One MCAP file of protobuf messages; see `McapFile`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._opened() as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise RecordingError(
                    f"{path} does not start as an MCAP file and is no recording; give a recording.mcap."
                )
            try:
                self.whole = self._has_statistics(stream)
                self.part = self._part(stream)
            except DAMAGE as error:
                raise damaged(path, error) from error

    def _has_statistics(self, stream: IO[bytes]) -> bool:
        if not index_start(stream):
            return False
        summary = index_reader(stream).get_summary()
        return summary is not None and summary.statistics is not None

    def _part(self, stream: IO[bytes]) -> Part:
        """Return what the file says of its place; one that was never finished says at its start which part it is."""
        is_empty, texts = False, {}
        if self.whole:
            texts = {entry.name: entry.metadata for entry in index_reader(stream).iter_metadata()}
        else:
            if end_of_records(stream) == len(MAGIC):
                raise RecordingError(
                    f"{self.path} ends within its first record and holds nothing; give a recording.mcap."
                )
            is_empty = True
            for record in self._in_order(stream):
                if isinstance(record, McapMessage) or PART_METADATA in texts:
                    is_empty = False
                    break
                if isinstance(record, Metadata):
                    texts[record.name] = record.metadata
        said = texts.get(PART_METADATA, {})
        if newer := newer_format(said):
            raise RecordingError(f"The recording {self.path} cannot be read: {newer}.")
        return Part(
            path=self.path,
            recording=said.get("recording", ""),
            number=int(said.get("number", "0")),
            next_file=texts.get(SUMMARY_METADATA, {}).get("next_file", ""),
            is_empty=is_empty and PART_METADATA not in texts,
        )

    def _in_order(self, stream: IO[bytes]) -> Iterator[McapRecord]:
        """Yield the records of a file without an index, up to the last whole one."""
        if index_start(stream) is None:
            return whole_records(stream)
        stream.seek(0)
        return RecordReader(stream).records

    @contextmanager
    def _opened(self) -> Iterator[IO[bytes]]:
        try:
            stream = open_regular(self.path)
        except (FileNotFoundError, ValueError) as error:
            # ValueError: no name on this system, for it holds a zero byte.
            raise MissingFileError(self.path) from error
        except IsADirectoryError as error:
            raise RecordingError(f"{str(self.path)!r} is a folder; give the path of an .mcap file.") from error
        except OSError as error:
            raise unreadable(self.path, error) from error
        with stream:
            try:
                yield stream
            except OSError as error:
                raise unreadable(self.path, error) from error

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield the messages of one type; see `McapFile.messages`."""
        name = kind.DESCRIPTOR.full_name
        with self._opened() as stream:
            try:
                for data in self._indexed(stream, name) if self.whole else self._streamed(stream, name):
                    yield cast("MessageT", kind.FromString(data))
            except DAMAGE as error:
                raise damaged(self.path, error) from error

    def _indexed(self, stream: IO[bytes], schema_name: str) -> Iterator[bytes]:
        summary = index_reader(stream).get_summary() or Summary()
        schemas = {schema.id for schema in summary.schemas.values() if schema.name == schema_name}
        channels = {channel.id for channel in summary.channels.values() if channel.schema_id in schemas}
        # A chunk that is not read may be damaged without harm to those that are.
        for chunk in summary.chunk_indexes:
            if chunk.message_index_offsets.keys() & channels:
                expect_chunk(stream, chunk)
                for message in messages_at(stream, chunk.chunk_start_offset, channels):
                    yield message.data

    def _streamed(self, stream: IO[bytes], schema_name: str) -> Iterator[bytes]:
        schemas: dict[int, str] = {}
        wanted: set[int] = set()
        for record in self._in_order(stream):
            match record:
                case Schema():
                    schemas[record.id] = record.name
                case Channel() if schemas.get(record.schema_id) == schema_name:
                    wanted.add(record.id)
                case McapMessage() if record.channel_id in wanted:
                    yield record.data
                case _:
                    pass

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named sets of texts; see `McapFile.metadata`."""
        with self._opened() as stream:
            try:
                records = index_reader(stream).iter_metadata() if self.whole else self._in_order(stream)
                return {record.name: dict(record.metadata) for record in records if isinstance(record, Metadata)}
            except DAMAGE as error:
                raise damaged(self.path, error) from error
