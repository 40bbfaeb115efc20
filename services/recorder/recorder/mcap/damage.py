"""What reading a damaged MCAP file raises, and what that says in words."""

from __future__ import annotations

import struct
from typing import Final

from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from zstandard import ZstdError

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


def reason_of(error: Exception) -> str:
    """Return what is wrong, without a full stop: several of these errors say nothing, or a bare number.

    Parameters
    ----------
    error : Exception
        One of `DAMAGE`.

    Returns
    -------
    str
        A clause, e.g. "a record ends before its own length says".
    """
    match error:
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
