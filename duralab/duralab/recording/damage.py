"""What reading a damaged or missing MCAP file raises, and the sentence that it becomes."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from zstandard import ZstdError

from duralab.errors import InputError
from duralab_proto.arrays import ArrayError

DAMAGE: Final = (
    McapError,
    DecodeError,
    struct.error,
    ValueError,
    LookupError,
    RuntimeError,
    OverflowError,
    ZstdError,
)
"""What reading a damaged file raises, in the container, its compression and its messages."""


def damaged(path: Path, error: Exception | str) -> InputError:
    """Return the sentence for a file that is damaged, of what was raised or in words."""
    reason = error if isinstance(error, str) else _reason(error)
    return InputError(f"The recording {path} is damaged ({reason}); `duralab verify {path}` says where.")


def unreadable(path: Path, error: OSError) -> InputError:
    """Return the sentence for a file that the system does not give, e.g. one that was deleted since it was opened."""
    reason = error.strerror or error
    return InputError(f"The recording {path} cannot be read: {reason}; give the path of an .mcap file.")


@contextmanager
def within_contract(path: Path) -> Iterator[None]:
    """Refuse a recording whose arrays are none of the contract while they are decoded; raises InputError."""
    try:
        yield
    except ArrayError as error:
        raise InputError(f"The recording {path} holds what its contract does not allow: {error}") from error


def _reason(error: Exception) -> str:
    """Return what is wrong: several of these errors say nothing, or a bare number."""
    match error:
        case EndOfFile():
            return "a record ends before its own length says"
        case struct.error():
            return "a number in a record is cut short"
        case UnicodeDecodeError():
            return "a text in it is no UTF-8"
        case KeyError():
            return f"a record names the channel or schema {', '.join(map(str, error.args))}, which it does not hold"
        case DecodeError():
            return "a message in it cannot be decoded"
        case _:
            return str(error).rstrip(".") or type(error).__name__
