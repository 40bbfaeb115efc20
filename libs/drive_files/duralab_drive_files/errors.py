"""Errors of a drive or response file, its map or its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from duralab_settings import require_regular


class DriveFileError(ValueError):
    """A file, a map or a setting that cannot be used.

    Parameters
    ----------
    sentence : str
        One sentence: the wrong value, the allowed values and the remedy.
    path : Path, optional
        File with the error.
    offset : int, optional
        Byte of the file at which the error was found; None for the file as a whole.
    field : str
        Wrong setting, e.g. "points_per_frame"; empty if there is none.
    """

    def __init__(self, sentence: str, *, path: Path | None = None, offset: int | None = None, field: str = "") -> None:
        place = "" if path is None else f"{path}{'' if offset is None else f', byte {offset}'}: "
        super().__init__(f"{place}{sentence}")
        self.sentence = sentence
        self.path = path
        self.offset = offset
        self.field = field


@contextmanager
def opened(path: Path) -> Iterator[None]:
    """Convert an error of the operating system to one sentence.

    Parameters
    ----------
    path : Path
        File that is read.

    Yields
    ------
    None

    Raises
    ------
    DriveFileError
        If the operating system refuses the file.
    """
    try:
        yield
    except OSError as error:
        sentence = f"it cannot be read ({error.strerror or error}); give a file that is there."
        raise DriveFileError(sentence, path=path) from error


def require_file(path: Path) -> int:
    """Return the size of a regular file that is not empty.

    Parameters
    ----------
    path : Path
        Path of the file.

    Returns
    -------
    int
        Size in bytes.

    Raises
    ------
    DriveFileError
        If it cannot be read, is a folder or is empty.
    """
    with opened(path):
        try:
            size = require_regular(path).st_size
        except IsADirectoryError:
            raise DriveFileError("this is a folder; give a file.", path=path) from None
    if size == 0:
        raise DriveFileError("the file is empty; a header was expected.", path=path, offset=0)
    return size
