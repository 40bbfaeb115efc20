"""Files of a recording, `<name>.mcap`, `<name>.part02.mcap`, …, as one chain, and their messages by type.

Each file states its recording and the number of its part, and each end the file in which the recording continues. Only
`verify` checks the hash of the previous file: that requires a reading of every byte.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, TypeVar, cast

from google.protobuf.message import Message
from mcap.reader import SeekingReader
from mcap.records import Channel, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage

from duralab_recordings.damage import DAMAGE, MissingFileError, RecordingError, damaged, unreadable
from duralab_recordings.index import expect_chunk, index_of, index_reader, index_start, messages_at
from duralab_recordings.unfinished import MAGIC, RecordReader, end_of_records, whole_records
from duralab_settings import open_regular

FORMAT_VERSION: Final = 2
"""Version of the format that this recorder writes; it also reads earlier versions.

1: steps carry the samples of their runs, files name no version. 2: steps name the hash of their run's samples, which
are in its signal blocks only; `accept` is part of the specification.
"""

PART_METADATA: Final = "part"
"""Name of the metadata at the start of each file: its recording, the number of its part, and the format version."""

SUMMARY_METADATA: Final = "summary"
"""Name of the metadata at the end of each file: the stored content so far, and the file in which it continues."""

_VERSION: Final = "format_version"


def part_metadata(recording: str, *, number: int, previous: Path | None, previous_sha256: str) -> dict[str, str]:
    """Return the metadata at the start of a file about its place in the chain.

    Parameters
    ----------
    recording : str
        Id of the recording.
    number : int
        Number of the file, from 1.
    previous : Path or None
        Previous file.
    previous_sha256 : str
        SHA-256 (hexadecimal) of the previous file; empty if there is none.

    Returns
    -------
    dict of str to str
        Content of `PART_METADATA`.
    """
    return {
        _VERSION: str(FORMAT_VERSION),
        "recording": recording,
        "number": str(number),
        "previous_file": "" if previous is None else previous.name,
        "previous_sha256": previous_sha256,
    }


def newer_format(said: Mapping[str, str]) -> str:
    """Return as a clause that a file's format is too new to read; empty if it can be read.

    Parameters
    ----------
    said : mapping of str to str
        Content of its `PART_METADATA`.

    Returns
    -------
    str
        Clause with the version and the remedy, without a full stop.
    """
    version = said.get(_VERSION, "1")
    if version.isdecimal() and 1 <= int(version) <= FORMAT_VERSION:
        return ""
    return (
        f"it has format version {version[:20]}, and this version of Duralab reads versions 1 to {FORMAT_VERSION}; take "
        "the Duralab that recorded it, or a newer one"
    )


@dataclass(frozen=True)
class Part:
    """Place of a file in the chain, as the file states it; empty or 0 if it does not.

    `next_file`: Name of the file in which the recording continues. `is_empty`: The file was begun and never finished,
    and has neither part metadata nor a message.
    """

    path: Path
    recording: str
    number: int
    next_file: str
    is_empty: bool = False


def part_path(path: Path, number: int) -> Path:
    """Return the path of a part of a recording whose first file is `path`.

    Parameters
    ----------
    path : Path
        First file of the recording.
    number : int
        Number of the part; 1 is the first file.

    Returns
    -------
    Path
        Path of the part.
    """
    return path if number == 1 else path.with_name(f"{path.stem}.part{number:02d}{path.suffix}")


def parts_beside(path: Path) -> dict[int, Path]:
    """Return the files beside a recording's first one that are named as its parts, by number, in order.

    Parameters
    ----------
    path : Path
        First file of the recording.

    Returns
    -------
    dict[int, Path]
        Path of each part, by its number.

    Raises
    ------
    RecordingError
        If the folder cannot be listed.
    """
    name = re.compile(rf"{re.escape(path.stem)}\.part(?P<number>\d{{2,}}){re.escape(path.suffix)}")
    found: dict[int, Path] = {}
    try:
        with os.scandir(path.parent) as entries:
            for entry in entries:
                match = name.fullmatch(entry.name)
                number = 0 if match is None else int(match["number"])
                if number > 1 and entry.name == part_path(path, number).name and entry.is_file():
                    found[number] = part_path(path, number)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise RecordingError(
            f"The folder of {path} cannot be listed ({error.strerror}), so that it is unknown if it continues in "
            "other files; allow it to be read."
        ) from error
    return dict(sorted(found.items()))


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording in order, the first one given."""
    following = parts_beside(path)
    for expected, number in enumerate(following, start=2):
        if number != expected:
            raise RecordingError(
                f"{part_path(path, expected)} is missing, though {following[number].name} is there; copy all parts of "
                f"the recording beside {path.name}."
            )
    return [path, *following.values()]


def require_chain(parts: Sequence[Part]) -> None:
    """Refuse files that are not the parts of one recording in order, from its first to its last."""
    first, last = parts[0], parts[-1]
    recording = next((part.recording for part in parts if part.recording), "")
    named = re.fullmatch(r"(?P<stem>.+)\.part\d{2,}", first.path.stem)
    if first.number > 1 and named is not None:
        raise RecordingError(
            f"{first.path} is part {first.number} of the recording {recording!r}; open its first file, "
            f"{first.path.with_name(named['stem'] + first.path.suffix)}, which reads the others with it."
        )
    for number, part in enumerate(parts, start=1):
        if part.is_empty and part is last:
            # Its recorder was killed while it began the file: no data is missing without it.
            continue
        # Older recorders wrote no such metadata into a first file, but into each following one.
        if part.recording != recording and (part.recording or number > 1):
            said = f"of the recording {part.recording!r}" if part.recording else "of a recording that it does not name"
            raise RecordingError(
                f"{part.path} is {said}, where part {number} of {recording!r} belongs; put that one in its place."
            )
        if part.number not in (number, 0):
            raise RecordingError(
                f"{part.path} is part {part.number} of the recording {recording!r}, where part {number} belongs; give "
                "each part the name that its recorder gave it."
            )
    if last.next_file:
        raise RecordingError(
            f"The recording {first.path} continues in {part_path(first.path, len(parts) + 1).name}, which is missing; "
            "copy all its parts beside it."
        )


def open_end(path: Path, *, parts: int, reason: str) -> str:
    """Return as text that a recording ends with a file after which its recorder may have continued in another.

    A file that was repaired after its recorder was killed names no next one: at the repair there was none.
    """
    why = f"{reason[:1].lower()}{reason[1:]}".rstrip(".") or "it was not closed"
    following = part_path(path, parts + 1).name
    return f"{why}, and the recording may continue in {following} and further, which are not beside {path.name}."


MessageT = TypeVar("MessageT", bound=Message)

EPOCH: Final = "epoch"
"""Key of a stream channel's metadata: the epoch of its publisher."""


def epoch_of(channel: Channel) -> int:
    """Return the epoch of a stream's publisher; 0 for a channel that is not a stream's."""
    return int(channel.metadata.get(EPOCH, "0"))


class McapFile:
    """MCAP files of protobuf messages that are one recording.

    Parameters
    ----------
    path : Path
        First file; the following ones are beside it.

    Raises
    ------
    RecordingError
        The file does not exist, is not an MCAP file or has a newer format, its index is damaged, or the files are not
        one complete chain.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # The first one is opened before others are searched: an impossible file name gets its own error.
        first = _OneFile(path)
        self._files = [first, *(_OneFile(file) for file in files_of(path)[1:])]
        require_chain([file.part for file in self._files])

    @property
    def paths(self) -> list[Path]:
        """Paths of its files, in order."""
        return [file.path for file in self._files]

    @property
    def whole(self) -> bool:
        """False if a file has no index at its end: its writer was killed, and the written part is read in order."""
        return all(file.whole for file in self._files)

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield the messages of one type in the order of writing, one in memory at a time."""
        for file in self._files:
            yield from file.messages(kind)

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the metadata of the files by name, the last of each name; those of an unfinished file too."""
        found: dict[str, dict[str, str]] = {}
        for file in self._files:
            found |= file.metadata()
        return found

    def open_end(self) -> str:
        """Return as a clause that the last file is whole and the recording may continue in another; see `open_end`."""
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
                # Read once: the index is as long as the number of chunks.
                reader = index_reader(stream) if index_start(stream) else None
                summary = None if reader is None else reader.get_summary()
                self.whole = summary is not None and summary.statistics is not None
                self.part = self._part(stream, reader if self.whole else None)
            except DAMAGE as error:
                raise damaged(path, error) from error

    def _part(self, stream: IO[bytes], reader: SeekingReader | None) -> Part:
        """Return the place of the file in the chain; one that was never finished states its part at its start."""
        is_empty, texts = False, {}
        if reader is not None:
            texts = {entry.name: entry.metadata for entry in reader.iter_metadata()}
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
            # ValueError: not a possible name on this system, since it holds a zero byte.
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
        summary = index_of(self.path)
        schemas = {schema.id for schema in summary.schemas.values() if schema.name == schema_name}
        channels = {channel.id for channel in summary.channels.values() if channel.schema_id in schemas}
        # Only needed chunks are read, so that a damaged other one does no harm.
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
        """Return the metadata by name; see `McapFile.metadata`."""
        with self._opened() as stream:
            try:
                records = index_reader(stream).iter_metadata() if self.whole else self._in_order(stream)
                return {record.name: dict(record.metadata) for record in records if isinstance(record, Metadata)}
            except DAMAGE as error:
                raise damaged(self.path, error) from error
