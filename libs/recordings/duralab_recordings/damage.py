"""Errors of reading a damaged or missing MCAP file, and their sentence."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from zstandard import ZstdError

from duralab_proto.arrays import ArrayError

DAMAGE: Final = (
    McapError,
    DecodeError,
    EOFError,
    struct.error,
    ValueError,
    LookupError,
    RuntimeError,
    OverflowError,
    ZstdError,
)
"""Exceptions of reading a damaged file: of the container, its compression and its messages."""


class RecordingError(Exception):
    """A recording that cannot be read: missing, damaged, of a newer format, no recording, or without requested data.

    Parameters
    ----------
    message : str
        One sentence: the file or run, its fault, the remedy.
    reason : str
        Only the fault, a clause; the message if omitted.
    """

    def __init__(self, message: str, *, reason: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.reason = reason or message.rstrip(".")


class MissingFileError(RecordingError):
    """File that does not exist.

    Parameters
    ----------
    path : Path
        Path of the file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(f"There is no recording {str(path)!r}; give the path of an .mcap file.")
        self.path = path


class MissingSamplesError(RecordingError):
    """Missing samples of a run: blocks were lost, or the run was aborted."""


def reason_of(error: Exception) -> str:
    """Return the fault, without a full stop: several of these errors have no text, or only a number.

    Parameters
    ----------
    error : Exception
        One of `DAMAGE`, or a RecordingError.

    Returns
    -------
    str
        A clause, e.g. "a record ends before its own length says".
    """
    match error:
        case RecordingError():
            reason = error.reason
        case InvalidMagic():
            reason = "it does not begin as an MCAP file"
        case EndOfFile():
            reason = "a record ends before its own length says"
        case struct.error():
            reason = "a number in a record is cut short"
        case UnicodeDecodeError():
            reason = "a text in it is no UTF-8"
        case KeyError(args=(int(number),)):
            reason = f"a record names the channel or schema {number}, which it does not hold"
        case KeyError():
            reason = f"an entry {error} is missing in it"
        case DecodeError():
            reason = "a message in it cannot be decoded"
        case _:
            reason = str(error).rstrip(".") or type(error).__name__
    return reason


def damaged(path: Path, error: Exception | str) -> RecordingError:
    """Return the error of a damaged file, from one of `DAMAGE` or from a clause."""
    reason = error if isinstance(error, str) else reason_of(error)
    return RecordingError(
        f"The recording {path} is damaged ({reason}); `duralab verify {path}` says where.", reason=reason
    )


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Return the error of a file that the system cannot read, e.g. one that was deleted after it was opened.

    Parameters
    ----------
    path : Path
        Path of the file.
    error : OSError
        Error of the system.

    Returns
    -------
    RecordingError
        Error to raise.
    """
    reason = error.strerror or error
    return RecordingError(f"The recording {path} cannot be read: {reason}; give the path of an .mcap file.")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert the errors of the system or of a damaged file to RecordingError while it is read."""
    try:
        yield
    except OSError as error:
        raise unreadable(path, error) from error
    except DAMAGE as error:
        raise damaged(path, error) from error


@contextmanager
def within_contract(path: Path) -> Iterator[None]:
    """Refuse a recording whose arrays violate the contract while they are decoded.

    Parameters
    ----------
    path : Path
        Path of the file, for the sentence.

    Yields
    ------
    None
        Nothing, to the code that decodes.

    Raises
    ------
    RecordingError
        Replaces ArrayError.
    """
    try:
        yield
    except ArrayError as error:
        raise RecordingError(
            f"The recording {path} holds what its contract does not allow: {error}", reason=str(error).rstrip(".")
        ) from error
