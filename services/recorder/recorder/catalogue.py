"""The recordings that lie in a folder: what they are, pieces of their files, whether they are whole."""

from __future__ import annotations

import hashlib
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Final

from duralab_proto.keys import check_id
from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.mcap_audit import audit, read_summary
from recorder.refused import RefusedError, invalid

LARGEST_PART: Final = 8 * 1024 * 1024
"""Bytes of a file in one answer."""


class Part(StrEnum):
    """The files of a recording."""

    RECORDING = "recording"
    LIVE = "live"


_SUFFIX: Final = {Part.RECORDING: ".mcap", Part.LIVE: ".rrd"}


def checked_name(name: str, *, field: str) -> str:
    """Return the id of a recording if it may be one; it becomes a file name, so nothing else may be in it."""
    try:
        return check_id(name)
    except ValueError as error:
        raise invalid(str(error), field=field) from error


def recording_path(folder: Path, name: str, part: Part = Part.RECORDING) -> Path:
    """Return where a file of a recording lies; the id is checked again here, where it becomes a path."""
    return folder / (checked_name(name, field="recording") + _SUFFIX[part])


def recordings_in(folder: Path) -> list[str]:
    """Return the ids of the recordings in a folder, sorted; other files are passed over."""
    names = []
    for path in folder.glob(f"*{_SUFFIX[Part.RECORDING]}"):
        try:
            names.append(check_id(path.stem))
        except ValueError:
            continue
    return sorted(names)


def existing_file(folder: Path, name: str, part: Part = Part.RECORDING) -> Path:
    """Return a file of a recording, or refuse with NOT_FOUND."""
    path = recording_path(folder, name, part)
    # A link could lead out of the folder.
    if path.is_symlink() or not path.is_file():
        raise RefusedError(
            query_pb2.FAULT_CODE_NOT_FOUND,
            f"There is no file {path.name}; recorder/recording/list names the recordings.",
            field="recording",
        )
    return path


def describe(path: Path) -> recorder_pb2.RecordingInfo:
    """Describe a recording's file that is not written any more.

    Returns
    -------
    recorder_pb2.RecordingInfo
        `closed` is false where the file ends without its index, because its recorder was killed.
    """
    status = path.stat()
    information = recorder_pb2.RecordingInfo(recording=path.stem, bytes=status.st_size, file=path.name)
    summary = read_summary(path)
    if summary is None:
        found = audit(path)
        information.steps = len(found.step_hashes)
        information.signal_blocks = found.signal_blocks
        information.missing_blocks = found.missing_blocks
        return information
    information.closed = True
    information.steps = summary.steps
    information.signal_blocks = summary.signal_blocks
    information.missing_blocks = summary.missing_blocks
    information.file_hash = _file_hash(path, status.st_size, status.st_mtime_ns)
    return information


@lru_cache(maxsize=256)
def _file_hash(path: Path, size: int, changed: int) -> str:
    del size, changed  # They are the cache's key: another file of that name has others.
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_part(folder: Path, name: str, request: recorder_pb2.ReadRecordingRequest) -> recorder_pb2.RecordingPart:
    """Read a piece of a recording's file.

    Raises
    ------
    RefusedError
        No such file, or a piece that is not in it.
    """
    try:
        part = Part(request.part)
    except ValueError as error:
        allowed = " or ".join(repr(part.value) for part in Part)
        raise invalid(f"part is {request.part[:40]!r}; allowed are {allowed}.", field="part") from error
    if not 1 <= request.length <= LARGEST_PART:
        raise invalid(f"length is {request.length}; allowed are 1 to {LARGEST_PART} bytes.", field="length")
    path = existing_file(folder, name, part)
    total = path.stat().st_size
    if request.offset > total:
        raise invalid(f"offset is {request.offset}; the file has {total} bytes.", field="offset")
    with path.open("rb") as stream:
        stream.seek(request.offset)
        data = stream.read(request.length)
    return recorder_pb2.RecordingPart(offset=request.offset, data=data, total=total)


def verify(folder: Path, name: str) -> recorder_pb2.VerifyResult:
    """Read a whole recording and say what is wrong with it.

    Raises
    ------
    RefusedError
        There is no such recording.
    """
    findings = audit(existing_file(folder, name)).findings
    return recorder_pb2.VerifyResult(recording=name, whole=not findings, findings=findings)
