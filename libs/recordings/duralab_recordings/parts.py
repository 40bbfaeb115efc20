"""The files of one recording: `<name>.mcap`, `<name>.part02.mcap`, …, and whether they are one chain.

Each file says which part of which recording it is, and the end of each which file it goes on in. What the hash of the
file before says is left to `verify`: it takes a reading of every byte.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from duralab_recordings.damage import RecordingError

FORMAT_VERSION: Final = 2
"""Version of the format that a recorder of this project writes; each reads those of before.

1: steps carry the samples of their runs, files name no version. 2: steps name the hash of their run's samples, which
are in its signal blocks only; `accept` is part of the specification.
"""

PART_METADATA: Final = "part"
"""Named set of texts at the start of each file: which part of which recording it is, and the version of its format."""

SUMMARY_METADATA: Final = "summary"
"""Named set of texts at the end of each file: what is stored so far, and which file it goes on in."""

_VERSION: Final = "format_version"


def part_metadata(recording: str, *, number: int, previous: Path | None, previous_sha256: str) -> dict[str, str]:
    """Return what a file says at its start about its place.

    Parameters
    ----------
    recording : str
        Id of the recording.
    number : int
        Of the file, from 1.
    previous : Path or None
        The file before it.
    previous_sha256 : str
        SHA-256 (hexadecimal) of that; empty where there is none.

    Returns
    -------
    dict of str to str
        The texts of `PART_METADATA`.
    """
    return {
        _VERSION: str(FORMAT_VERSION),
        "recording": recording,
        "number": str(number),
        "previous_file": "" if previous is None else previous.name,
        "previous_sha256": previous_sha256,
    }


def newer_format(said: Mapping[str, str]) -> str:
    """Return in a clause that a file cannot be read because its format is newer; empty where it can.

    Parameters
    ----------
    said : mapping of str to str
        The texts of its `PART_METADATA`.

    Returns
    -------
    str
        With the version and what to do, without a full stop.
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
    """What a file says of its place; empty or 0 where it does not say.

    `next_file`: Name of the file in which the recording goes on. `is_empty`: It was begun and never finished, and
    neither says what it is nor holds a message.
    """

    path: Path
    recording: str
    number: int
    next_file: str
    is_empty: bool = False


def part_path(path: Path, number: int) -> Path:
    """Return where a part of a recording lies whose first file is `path`.

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
    """Return the files beside a recording's first one that are named as parts of it, by number, in order.

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
        Its folder cannot be listed.
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
            f"The folder of {path} cannot be listed ({error.strerror}), so that it is not known whether it goes on in "
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
    """Refuse files that are not the parts of one recording in their order, from its first to its last."""
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
            # Its recorder was killed as it began the file: nothing is missing without it.
            continue
        # A recorder of before wrote no such texts into a first file; into one that follows, each writes them.
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
            f"The recording {first.path} goes on in {part_path(first.path, len(parts) + 1).name}, which is missing; "
            "copy all its parts beside it."
        )


def open_end(path: Path, *, parts: int, reason: str) -> str:
    """Return in words that a recording ends with a file after which its recorder may have gone on in another.

    A file that was repaired after its recorder was killed names no next one: when it was repaired there was none.
    """
    why = f"{reason[:1].lower()}{reason[1:]}".rstrip(".") or "it was not closed"
    following = part_path(path, parts + 1).name
    return f"{why}, and the recording may go on in {following} and further, which are not beside {path.name}."
