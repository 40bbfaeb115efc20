"""Files of a recording and their names: `<id>.mcap`, `<id>.part02.mcap`, …."""

from __future__ import annotations

import hashlib
import re
from enum import StrEnum
from pathlib import Path
from typing import Final

from duralab_proto.keys import check_id
from duralab_proto.v1 import query_pb2
from duralab_recordings import part_path, parts_beside
from recorder.refused import RefusedError, invalid

DAMAGED_FOLDER: Final = "damaged"
"""Folder beside the recordings: copies of the files that a killed recorder left, made before their repair."""

# An id has no dot, so the first file of one id cannot have the name of another id's second file.
_FILE = re.compile(r"(?P<id>[^.]+)(\.part(?P<number>\d{2,}))?\.mcap")


class Part(StrEnum):
    """Stored part of a recording."""

    RECORDING = "recording"
    LIVE = "live"


_SUFFIX: Final = {Part.RECORDING: ".mcap", Part.LIVE: ".rrd"}


def checked_name(name: str, *, field: str) -> str:
    """Return the id of a recording, checked: it becomes a file name, so it may hold no other characters."""
    try:
        return check_id(name)
    except ValueError as error:
        raise invalid(str(error), field=field) from error


def recording_path(folder: Path, name: str, part: Part = Part.RECORDING, *, number: int = 1) -> Path:
    """Return the path of a recording's file, number 1 or higher; the id is checked here again."""
    return part_path(folder / (checked_name(name, field="recording") + _SUFFIX[part]), number)


def files_of(folder: Path, name: str) -> list[Path]:
    """Return the MCAP files of a recording in their order, up to a missing number."""
    files: list[Path] = []
    # A link could lead out of the folder.
    while (path := recording_path(folder, name, number=len(files) + 1)).is_file() and not path.is_symlink():
        files.append(path)
    return files


def files_after_a_gap(folder: Path, name: str) -> list[Path]:
    """Return the MCAP files of a recording after a missing file, in their order."""
    known = len(files_of(folder, name))
    return [path for number, path in parts_beside(recording_path(folder, name)).items() if number > known]


def recordings_in(folder: Path) -> list[str]:
    """Return the ids of the recordings in a folder, sorted; other files are ignored."""
    names = []
    for path in folder.glob(f"*{_SUFFIX[Part.RECORDING]}"):
        match = _FILE.fullmatch(path.name)
        # A link could lead out of the folder.
        if match is None or match["number"] is not None or path.is_symlink() or not path.is_file():
            continue
        try:
            names.append(check_id(match["id"]))
        except ValueError:
            continue
    return sorted(names)


def existing_file(folder: Path, name: str, part: Part = Part.RECORDING, *, number: int = 1) -> Path:
    """Return a file of a recording; raises NOT_FOUND if it is missing or a link."""
    path = recording_path(folder, name, part, number=number)
    # A link could lead out of the folder.
    if path.is_symlink() or not path.is_file():
        raise RefusedError(
            query_pb2.FAULT_CODE_NOT_FOUND,
            f"There is no recording {path.name}; `duralab catalogue` (recorder/recording/list) lists those there are.",
            field="recording",
        )
    return path


def sha256_of(path: Path) -> str:
    """Return the SHA-256 (hexadecimal) of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
