"""What is said of files that are damaged, in words."""

from __future__ import annotations

import struct

import pytest
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile
from zstandard import ZstdError

from duralab_recordings import DAMAGE, reason_of
from recorder.reading import verify


@pytest.mark.parametrize("share", ["empty", "short text", "long text", "only begun"])
def test_a_file_that_is_none_is_told_in_words(tmp_path, share):
    content = {
        "empty": b"",
        "short text": b"hello",
        "long text": b"hello, this is no recording",
        "only begun": b"\x89MCAP0\r\n\x01",
    }[share]
    (tmp_path / "demo.mcap").write_bytes(content)
    first = verify(tmp_path, "demo").findings[0]
    reason = "it does not begin as an MCAP file" if "text" in share else "a record ends before its own length says"
    assert first == f"The file demo.mcap is damaged or ends after 0 messages: {reason}."


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (EndOfFile(), "a record ends before its own length says"),
        (struct.error("unpack requires a buffer of 8 bytes"), "a number in a record is cut short"),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), "a text in it is no UTF-8"),
        (KeyError(7), "a record names the channel or schema 7, which it does not hold"),
        (KeyError("recording"), "an entry 'recording' is missing in it"),
        (DecodeError("Error parsing message"), "a message in it cannot be decoded"),
        (ZstdError("cannot decompress."), "cannot decompress"),
        (OverflowError(), "OverflowError"),
    ],
)
def test_every_kind_of_damage_has_a_reason_in_words(error, told):
    assert isinstance(error, DAMAGE)
    assert reason_of(error) == told
