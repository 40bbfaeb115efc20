"""Output files: written atomically, and replacing existing files only on request."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from duralab.errors import InputError

OUTPUTS: Final = ("recording.mcap", "live.rrd", "report.html")
"""Files that a campaign leaves in its folder."""


def recording_in(path: Path) -> Path:
    """Return the recording in the folder of a campaign; another path as it is."""
    return path_in(path, "recording.mcap")


def path_in(folder: Path, name: str) -> Path:
    """Return the file of a name in a folder; the folder's own path if it has no such file."""
    inside = folder / name
    try:
        return inside if inside.is_file() else folder
    except OSError:  # e.g. a name that is too long, which is refused where the file is opened
        return folder


@contextmanager
def replace_when_complete(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` and rename it to `path` at the end; delete it after an error."""
    # A process id would not be unique: two containers that write one file, or a restarted one, can have the same id.
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written: {error.strerror or error}; give another place, or make room there."
        ) from error
    finally:
        # `missing_ok` does not cover a file where a folder is expected, or a name that is too long.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def require_outputs(paths: Iterable[Path], *, replace: bool, read: Iterable[Path] = ()) -> None:
    """Refuse outputs that are also input files, and without `replace` existing files."""
    paths = list(paths)
    require_other(paths, read=read)
    there = [path for path in paths if _is_there(path)]
    if there and not replace:
        raise InputError(
            f"{', '.join(str(path) for path in there)} would be overwritten; give --replace, or another folder or file."
        )


def require_other(paths: Iterable[Path], *, read: Iterable[Path]) -> None:
    """Refuse an output that is also one of its input files, also by another name or link."""
    sources = [source for source in read if _is_there(source)]
    for path in filter(_is_there, paths):
        if any(path.samefile(source) for source in sources):
            raise InputError(f"{path} is the file that is read; give another one for the output.", field="out")


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        raise InputError(f"{path} cannot be a file: {error.strerror}; give another name.") from error
