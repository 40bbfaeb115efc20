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
    """A file does not conform to its format.

    Parameters
    ----------
    path : Path
        Path of the file.
    sentence : str
        Wrong value and expected value.
    offset : int, optional
        Byte offset of the error; None if it is about the whole file.
    """

    def __init__(self, path: Path, sentence: str, *, offset: int | None = None) -> None:
        super().__init__(f"{path}{'' if offset is None else f', byte {offset}'}: {sentence}", field="file")
        self.path = path
        self.offset = offset


@contextmanager
def as_input_error() -> Iterator[None]:
    """Convert errors of the library about a file or a setting to errors of the SDK; also a decorator."""
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
    """Convert errors of the operating system about a file to an error sentence."""
    with as_input_error(), duralab_drive_files.opened(path):
        yield


def require_file(path: Path) -> int:
    """Return the size of a file in bytes."""
    with as_input_error():
        return duralab_drive_files.require_file(path)


@dataclass(frozen=True)
class Written:
    """Written file, and losses of its format.

    Parameters
    ----------
    path : Path
        Path of the file.
    format : str
        Value of `duralab.formats.Format`.
    samples : int
        Number of samples of each channel.
    padding : int
        Number of zeros after the samples, if the format stores whole groups; otherwise 0.
    largest_errors : tuple of float
        Largest difference between a sample and its stored value for each channel, in the channel's unit, measured while
        writing; 0 if samples are stored unchanged.
    notes : tuple of str
        Sentences about content that the format cannot store.
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
