"""Errors and results of readers and writers of files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import duralab_drive_files
from duralab.errors import InputError
from duralab_drive_files import DriveFileError
from duralab_settings import UnitError


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
def as_input_error() -> Iterator[None]:
    """Raise what the library says of a file or a setting as an error of the SDK; also a decorator."""
    try:
        yield
    except UnitError as error:
        raise InputError(str(error), field="unit") from error
    except DriveFileError as error:
        if error.path is None:
            raise InputError(str(error), field=error.field) from error
        raise FormatError(error.path, error.sentence, offset=error.offset) from error


@contextmanager
def opened(path: Path) -> Iterator[None]:
    """Turn what the operating system says of a file into one sentence."""
    with as_input_error(), duralab_drive_files.opened(path):
        yield


def require_file(path: Path) -> int:
    """Return the size of a file in bytes."""
    with as_input_error():
        return duralab_drive_files.require_file(path)


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
        """Return a description as text."""
        padding = f", {self.padding} zeros appended" if self.padding else ""
        return "\n- ".join((f"{self.path}: {self.samples} samples as {self.format}{padding}", *self.notes))
