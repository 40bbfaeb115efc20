"""Files of a recording, with errors of the SDK; the sentences are from `duralab_recordings`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from google.protobuf.message import Message

from duralab.errors import InputError
from duralab.near_files import did_you_mean
from duralab_recordings import (
    McapFile,
    MissingFileError,
    RecordingError,
    RunSignals,
    Window,
)
from duralab_recordings import parts_beside as _parts_beside

MessageT = TypeVar("MessageT", bound=Message)


@contextmanager
def input_errors() -> Iterator[None]:
    """Convert errors of a recording to InputError."""
    try:
        yield
    except MissingFileError as error:
        raise InputError(f"{error.message.removesuffix('.')}{did_you_mean(error.path)}") from error
    except RecordingError as error:
        raise InputError(error.message) from error


def parts_beside(path: Path) -> dict[int, Path]:
    """Return the part files beside a recording's first file, by number, in order.

    `path`: First file of the recording.
    Returns: Path of each part, by its number.
    Raises `InputError`: The folder cannot be listed.
    """
    with input_errors():
        return _parts_beside(path)


class RecordingFiles(McapFile):
    """MCAP files of one recording; errors are InputError.

    `path`: First file; the parts are beside it.
    Raises `InputError`: There is no such file, it is not a recording or has a newer format, it is damaged, or a part is
    missing.
    """

    def __init__(self, path: Path) -> None:
        with input_errors():
            super().__init__(path)

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield the messages of one type in the order they were written.

        `kind`: Message type of the contract.
        Yields: Messages of that type.
        Raises `InputError`: A file is damaged at a message.
        """
        with input_errors():
            yield from super().messages(kind)

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named metadata of the files; raises InputError if a file is damaged."""
        with input_errors():
            return super().metadata()


class SignalWindows(RunSignals):
    """Reader of runs and parts of runs; errors are InputError."""

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs with signals, in the order of recording."""
        with input_errors():
            return super().runs

    def end(self, run: str) -> tuple[int, float, bool]:
        """Return the number of samples of a run, its rate in hertz, and whether its last block is recorded."""
        with input_errors():
            return super().end(run)

    def read(self, run: str, first: int, last: int) -> Window:
        """Read the samples from `first` to the one before `last` of a run; the arrays are read-only and cached."""
        with input_errors():
            return super().read(run, first, last)
