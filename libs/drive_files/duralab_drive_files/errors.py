"""Errors of a drive or response file, its map or its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from duralab_settings import require_regular


class DriveFileError(ValueError):
    """A file, a map or a setting cannot be used.

    Parameters
    ----------
    sentence : str
        What is wrong with which value, what is allowed and what to do.
    path : Path, optional
        The file that is meant.
    offset : int, optional
        Byte of the file at which it went wrong; None where the file as a whole is meant.
    field : str
        Setting that is wrong, e.g. "points_per_frame"; empty where none is.
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
    """Turn what the operating system says of a file into one sentence.

    Parameters
    ----------
    path : Path
        The file that is read.

    Yields
    ------
    None

    Raises
    ------
    DriveFileError
        The operating system refused.
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
        The file.

    Returns
    -------
    int
        Its size in bytes.

    Raises
    ------
    DriveFileError
        It cannot be read, is a folder or is empty.
    """
    with opened(path):
        try:
            size = require_regular(path).st_size
        except IsADirectoryError:
            raise DriveFileError("this is a folder; give a file.", path=path) from None
    if size == 0:
        raise DriveFileError("the file is empty; a header was expected.", path=path, offset=0)
    return size
