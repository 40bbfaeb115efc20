"""Suggestion of the existing file that a mistyped path may mean."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Final

_MOST_ENTRIES: Final = 5_000
"""Maximum number of compared entries of a folder; more would delay the error message."""


def did_you_mean(path: str | Path, *, names: Iterable[str] = ()) -> str:
    """Return the end of a sentence about a file that does not exist: the nearest one in its folder, or a full stop."""
    path = Path(path)
    near = _nearest(path)
    offered = [*names, *([] if near is None else [str(near)])]
    found = _closest(str(path), {name.lower(): name for name in offered})
    return "." if found is None else f"; did you mean {found!r}?"


def _nearest(path: Path) -> Path | None:
    """Return the existing file with the most similar path; None if a missing part of the path has no similar name."""
    place = Path(path.anchor)
    *folders, name = path.parts[1 if path.anchor else 0 :] or ("",)
    for part in folders:
        if (place / part).is_dir():
            place /= part
        elif (near := _closest(part, _entries(place, folders=True))) is not None:
            place /= near
        else:
            return None
    if (place / name).is_file():
        return place / name
    near = _closest(name, _entries(place, folders=False))
    return None if near is None else place / near


def _entries(folder: Path, *, folders: bool) -> dict[str, str]:
    """Return the folders or the files in a folder by their names in lower case."""
    with suppress(OSError), os.scandir(folder) as entries:
        listed = islice(entries, _MOST_ENTRIES)
        return {entry.name.lower(): entry.name for entry in listed if entry.is_dir() is folders}
    return {}


def _closest(name: str, candidates: dict[str, str]) -> str | None:
    found = get_close_matches(name.lower(), candidates, n=1)
    return candidates[found[0]] if found else None
