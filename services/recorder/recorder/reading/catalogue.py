"""Recordings of a folder: description, search, pieces of their files, verification."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

from duralab_proto.v1 import recorder_pb2
from recorder.format import Part, Summary, existing_file, files_of, read_summary, sha256_of
from recorder.reading.file_audit import audit
from recorder.refused import invalid

LARGEST_PART: Final = 8 * 1024 * 1024
"""Largest number of bytes of a file in one answer."""

# More than a lab records in years, at a few hundred bytes each: repeated listing reads the end of each file once.
_REMEMBERED: Final = 65_536


def describe(
    folder: Path,
    name: str,
    *,
    written: recorder_pb2.RecordingInfo | None = None,
    waiting: str = "",
    hashed: bool = True,
) -> recorder_pb2.RecordingInfo:
    """Describe a recording from its files; closed files with their SHA-256 if `hashed`.

    `written`: Description by the writer of an open recording; its last file is then not closed. `waiting`: Reason
    why nothing can be written to it now. `closed` is false while it is written, and while its file waits for an end.
    A file without an end and without a writer is closed, because no data follows; `ended` states whether its last
    step is stored.
    """
    files = files_of(folder, name)
    information = recorder_pb2.RecordingInfo(recording=name)
    if written is not None:
        information.MergeFrom(written)
    elif (closing := _closing(*_version(files[-1]))) is not None:
        information.MergeFrom(closing)
    else:
        found = audit(files)
        information.MergeFrom(_information_of(found.content.summary_now(name, reason="")))
        information.closed = not waiting
        information.missing_blocks = found.missing_blocks
    for path in files:
        closed = information.closed or path != files[-1]
        version = _version(path)
        file_hash = _file_hash(*version) if hashed and closed else ""
        information.files.append(recorder_pb2.RecordingFile(file=path.name, bytes=version[1], file_hash=file_hash))
    information.waiting = waiting
    information.bytes = sum(file.bytes for file in information.files)
    information.file = files[0].name
    if len(files) > 1 or information.closed:
        information.file_hash = information.files[0].file_hash
    return information


def _information_of(summary: Summary) -> recorder_pb2.RecordingInfo:
    return recorder_pb2.RecordingInfo(
        steps=summary.steps,
        ended=summary.ended,
        signal_blocks=summary.signal_blocks,
        missing_blocks=summary.missing_blocks,
        **vars(summary.story),
    )


def _version(path: Path) -> tuple[Path, int, int]:
    """Return a cache key of a file: another file with its name has another size or time."""
    status = path.stat()
    return path, status.st_size, status.st_mtime_ns


@lru_cache(maxsize=_REMEMBERED)
def _file_hash(path: Path, size: int, changed: int) -> str:
    del size, changed
    return sha256_of(path)


@lru_cache(maxsize=_REMEMBERED)
def _closing(path: Path, size: int, changed: int) -> recorder_pb2.RecordingInfo | None:
    """Return the description in a closed file; callers copy it and do not change it."""
    del size, changed
    summary = read_summary(path)
    if summary is None:
        return None
    information = _information_of(summary)
    information.closed = True
    return information


def fits(information: recorder_pb2.RecordingInfo, request: recorder_pb2.ListRecordingsRequest) -> bool:
    """Return whether a recording matches the search."""
    return (
        (not request.rig or information.rig == request.rig)
        and request.target.casefold() in information.target.casefold()
        and information.begun >= request.begun_from
        and (not request.begun_before or 0 < information.begun < request.begun_before)
        and (not request.phase or information.phase == request.phase)
        and (not request.outcome or information.outcome == request.outcome)
    )


def read_part(folder: Path, name: str, request: recorder_pb2.ReadRecordingRequest) -> recorder_pb2.RecordingPart:
    """Read a piece of a recording's file, shorter at the end of the file."""
    try:
        part = Part(request.part)
    except ValueError as error:
        allowed = " or ".join(repr(part.value) for part in Part)
        raise invalid(f"part is {request.part[:40]!r}; allowed are {allowed}.", field="part") from error
    if not 1 <= request.length <= LARGEST_PART:
        raise invalid(f"length is {request.length}; allowed are 1 to {LARGEST_PART} bytes.", field="length")
    path = existing_file(folder, name, part, number=max(1, request.number) if part is Part.RECORDING else 1)
    total = path.stat().st_size
    if request.offset > total:
        raise invalid(f"offset is {request.offset}; the file has {total} bytes.", field="offset")
    with path.open("rb") as stream:
        stream.seek(request.offset)
        data = stream.read(request.length)
    return recorder_pb2.RecordingPart(offset=request.offset, data=data, total=total)


def verify(folder: Path, name: str) -> recorder_pb2.VerifyResult:
    """Read a whole recording and report its errors."""
    existing_file(folder, name)
    findings = audit(files_of(folder, name), name=name).findings
    return recorder_pb2.VerifyResult(recording=name, whole=not findings, findings=findings)
