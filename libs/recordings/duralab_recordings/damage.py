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
"""What reading a damaged file raises, in the container, its compression and its messages."""


class RecordingError(Exception):
    """A recording cannot be read: it is missing, damaged, of a newer format or no recording, or lacks what is asked.

    Parameters
    ----------
    message : str
        One sentence: which file or run, what is wrong with it, what to do.
    reason : str
        Only what is wrong, a clause; the message where not given.
    """

    def __init__(self, message: str, *, reason: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.reason = reason or message.rstrip(".")


class MissingFileError(RecordingError):
    """There is no such file.

    Parameters
    ----------
    path : Path
        The file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(f"There is no recording {str(path)!r}; give the path of an .mcap file.")
        self.path = path


class MissingSamplesError(RecordingError):
    """Samples of a run are missing: blocks were lost, or it was broken off."""


def reason_of(error: Exception) -> str:
    """Return what is wrong, without a full stop: several of these errors say nothing, or a bare number.

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
    """Return the error of a file that is damaged, from one of `DAMAGE` or from a clause."""
    reason = error if isinstance(error, str) else reason_of(error)
    return RecordingError(
        f"The recording {path} is damaged ({reason}); `duralab verify {path}` says where.", reason=reason
    )


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Return the error of a file that the system does not give, e.g. one that was deleted since it was opened.

    Parameters
    ----------
    path : Path
        The file.
    error : OSError
        What the system says.

    Returns
    -------
    RecordingError
        To be raised.
    """
    reason = error.strerror or error
    return RecordingError(f"The recording {path} cannot be read: {reason}; give the path of an .mcap file.")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise RecordingError for what the system or a damaged file raises while it is read."""
    try:
        yield
    except OSError as error:
        raise unreadable(path, error) from error
    except DAMAGE as error:
        raise damaged(path, error) from error


@contextmanager
def within_contract(path: Path) -> Iterator[None]:
    """Refuse a recording whose arrays are not those of the contract while they are decoded.

    Parameters
    ----------
    path : Path
        The file, for the sentence.

    Yields
    ------
    None
        To the code that decodes.

    Raises
    ------
    RecordingError
        Instead of ArrayError.
    """
    try:
        yield
    except ArrayError as error:
        raise RecordingError(
            f"The recording {path} holds what its contract does not allow: {error}", reason=str(error).rstrip(".")
        ) from error
