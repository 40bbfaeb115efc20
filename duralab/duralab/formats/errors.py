"""What readers and writers say of a file: what is wrong with it and where, or what was written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from duralab.errors import InputError
from duralab_settings import require_regular


class FormatError(InputError):
    """A file does not hold what its format asks for.

    Parameters
    ----------
    path : Path
        The file.
    sentence : str
        What is wrong with which value, and what was expected.
    offset : int, optional
        Byte of the file at which it went wrong; None where the file as a whole is meant.
    """

    def __init__(self, path: Path, sentence: str, *, offset: int | None = None) -> None:
        super().__init__(f"{path}{'' if offset is None else f', byte {offset}'}: {sentence}", field="file")
        self.path = path
        self.offset = offset


@contextmanager
def opened(path: Path) -> Iterator[None]:
    """Turn what the operating system says of a file into one sentence."""
    try:
        yield
    except OSError as error:
        raise FormatError(path, f"it cannot be read ({error.strerror or error}); give a file that is there.") from error


def require_file(path: Path) -> int:
    """Return the size of a file in bytes."""
    with opened(path):
        try:
            size = require_regular(path).st_size
        except IsADirectoryError:
            raise FormatError(path, "this is a folder; give a file.") from None
    if size == 0:
        raise FormatError(path, "the file is empty; a header was expected.", offset=0)
    return size


@dataclass(frozen=True)
class Written:
    """A file that was written, and what of the signals is not in it as it was.

    Parameters
    ----------
    path : Path
        The file.
    format : str
        Value of `duralab.formats.Format`.
    samples : int
        Samples of each channel.
    padding : int
        Zeros that follow them because the format stores whole groups; 0 where it does not.
    largest_errors : tuple of float
        For each channel the largest difference between a sample and what the file holds of it, in the channel's unit,
        measured while it was written; 0 where samples are stored as they are.
    notes : tuple of str
        Sentences about what the format could not keep.
    """

    path: Path
    format: str
    samples: int
    padding: int
    largest_errors: tuple[float, ...]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return it in words."""
        padding = f", {self.padding} zeros appended" if self.padding else ""
        return "\n- ".join((f"{self.path}: {self.samples} samples as {self.format}{padding}", *self.notes))
