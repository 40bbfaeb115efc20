"""Header of an RPC III time history: 128-byte records of a keyword and a value.

Source: MTS, "RPC File Formats". The header is made of blocks of 512 bytes, four records each; a record is a keyword of
32 bytes and a value of 96, both ended by NUL. `FORMAT`, `NUM_HEADER_BLOCKS` and `NUM_PARAMS` come first, in that order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from enum import Enum, StrEnum
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from duralab_drive_files.errors import DriveFileError
from duralab_drive_files.time_history import rate_of_step


class DataType(StrEnum):
    """Storage type of samples."""

    SHORT_INTEGER = "SHORT_INTEGER"
    FLOATING_POINT = "FLOATING_POINT"


class TimeType(StrEnum):
    """Type of a time history; the old numbers in the description are the positions, from 1."""

    DRIVE = "DRIVE"
    RESPONSE = "RESPONSE"
    MULT_DRIVE = "MULT_DRIVE"
    MULT_RESP = "MULT_RESP"
    CONFIG_DRIVE = "CONFIG_DRIVE"
    CONFIG_RESP = "CONFIG_RESP"
    PEAK_PICK = "PEAK_PICK"


class ByteOrder(StrEnum):
    """Byte order of the samples, as written by numpy."""

    LITTLE = "<"
    BIG = ">"


_CODES: Final = {DataType.SHORT_INTEGER: "i2", DataType.FLOATING_POINT: "f4"}


def stored_type(data_type: DataType, order: ByteOrder) -> np.dtype:
    """Return the numpy type of a stored sample."""
    return np.dtype(order.value + _CODES[data_type])


@dataclass(frozen=True)
class Layout:
    """Layout of the samples of a time history.

    Data are demultiplexed by groups: all points of a group of the first channel, then of the second, and so on.

    `channels`: 1 or more. `points_per_frame`, `points_per_group`: A group is a whole number of frames. `frames`: Frames
    of data, without the half frames at both ends. `half_frames`: Whether there is half a frame more at the start and at
    the end. `dtype`: Type of one sample in the file.
    """

    channels: int
    points_per_frame: int
    points_per_group: int
    frames: int
    half_frames: bool
    dtype: np.dtype

    @property
    def points(self) -> int:
        """Number of points of each channel in the frames."""
        return (self.frames + self.half_frames) * self.points_per_frame

    @property
    def groups(self) -> int:
        """Number of groups, the last of which may be padded."""
        return -(-self.points // self.points_per_group)

    @property
    def group_bytes(self) -> int:
        """Size in bytes of a group of all channels."""
        return self.channels * self.points_per_group * self.dtype.itemsize

    @property
    def data_bytes(self) -> int:
        """Size in bytes of all groups."""
        return self.groups * self.group_bytes


BLOCK: Final = 512
RECORD: Final = 128
KEYWORD: Final = 32
FIRST_KEYWORDS: Final = ("FORMAT", "NUM_HEADER_BLOCKS", "NUM_PARAMS")
INT_FULL_SCALE: Final = 32752
"""Integer at full scale in the description, for a file that states none."""

MOST_BLOCKS: Final = 4096
"""Largest number of header blocks. The description allows 256; writers with many channels or keywords exceed it."""

MOST_CHANNELS: Final = 1024
"""Largest number of channels. The description allows 128; files of other writers with more are read."""

TRUE_LENGTH: Final = "SAMPLES"
"""Keyword outside the description: the samples of each channel without the padding of the last group.

`rpc3-file` has the same one, so each reads the other's true length.
"""


_BYTE_ORDERS: Final = {
    "BINARY": ByteOrder.LITTLE,
    "BINARY_IEEE_LITTLE_END": ByteOrder.LITTLE,
    "BINARY_IEEE_BIG_END": ByteOrder.BIG,
}

EnumT = TypeVar("EnumT", bound=Enum)


@dataclass(frozen=True)
class Header:
    """Records of a header, by keyword in upper case, with checks of their values.

    `offsets`: Byte of each keyword's record. `size`: Bytes of the header; the data follow.
    """

    path: Path
    values: Mapping[str, str]
    offsets: Mapping[str, int]
    size: int

    def error(self, keyword: str, expected: str) -> DriveFileError:
        """Return the error of a keyword's value."""
        if keyword not in self.values:
            return DriveFileError(
                f"the header lacks {keyword}; {expected} was expected.", path=self.path, offset=self.size
            )
        value = self.values[keyword]
        return DriveFileError(
            f"{keyword} is {value!r}; {expected} was expected.",
            path=self.path,
            offset=self.offsets[keyword] + KEYWORD,
        )

    def integer(self, keyword: str, *, smallest: int, largest: int, default: int | None = None) -> int:
        """Return a whole number from `smallest` to `largest`; `default` if the keyword is missing or empty."""
        expected = f"a whole number from {smallest} to {largest}"
        text = self.values.get(keyword, "")
        if not text and default is not None:
            return default
        number = self._decimal(keyword, expected)
        # The bounds come first: a whole number of a huge exponent has as many digits.
        if not smallest <= number <= largest or number != int(number):
            raise self.error(keyword, expected)
        return int(number)

    def real(self, keyword: str, expected: str) -> float:
        """Return a finite number; a Fortran exponent (1.5D-3) is read as well."""
        number = float(self._decimal(keyword, expected))
        if not math.isfinite(number):
            raise self.error(keyword, expected)
        return number

    def _decimal(self, keyword: str, expected: str) -> Decimal:
        try:
            number = Decimal(self.values.get(keyword, "").upper().replace("D", "E"))
        except InvalidOperation:
            raise self.error(keyword, expected) from None
        if not number.is_finite():
            raise self.error(keyword, expected)
        return number

    def choice(self, keyword: str, kind: type[EnumT], default: EnumT) -> EnumT:
        """Return a member of an enum by its value, or by its position from 1, as in old files."""
        text = self.values.get(keyword, "").upper()
        members = list(kind)
        if not text:
            return default
        if text.isascii() and text.isdigit() and len(text) < 4 and 1 <= int(text) <= len(members):
            return members[int(text) - 1]
        for member in members:
            if member.value == text:
                return member
        raise self.error(keyword, " or ".join(str(member.value) for member in members))

    def sample_rate(self) -> float:
        """Return the sample rate in hertz.

        The resolution of the time step is half of the last digit of `DELTA_T`.
        """
        expected = "a time step in seconds, greater than 0"
        digits = self._decimal("DELTA_T", expected)
        step = float(digits)
        if not (0 < step < math.inf and math.isfinite(1 / step)):
            raise self.error("DELTA_T", expected)
        exponent = digits.as_tuple().exponent
        last_digit = 10.0**exponent if isinstance(exponent, int) else 0.0
        return rate_of_step(step, resolution=0.5 * last_digit)

    def layout(self) -> Layout:
        """Return the layout of the samples."""
        if self.values.get("FILE_TYPE", "TIME_HISTORY").upper() != "TIME_HISTORY":
            raise self.error("FILE_TYPE", "TIME_HISTORY")
        data_type = self.choice("DATA_TYPE", DataType, DataType.SHORT_INTEGER)
        order = _BYTE_ORDERS[self.values["FORMAT"].upper()]
        per_frame = self.integer("PTS_PER_FRAME", smallest=1, largest=2**24)
        per_group = self.integer("PTS_PER_GROUP", smallest=1, largest=2**24, default=per_frame)
        if per_group % per_frame:
            raise self.error("PTS_PER_GROUP", f"a multiple of PTS_PER_FRAME = {per_frame}")
        return Layout(
            channels=self.integer("CHANNELS", smallest=1, largest=MOST_CHANNELS),
            points_per_frame=per_frame,
            points_per_group=per_group,
            frames=self.integer("FRAMES", smallest=0, largest=2**31),
            half_frames=bool(self.integer("HALF_FRAMES", smallest=0, largest=1, default=0)),
            dtype=stored_type(data_type, order),
        )


def parse_header(path: Path, content: bytes) -> Header:
    """Parse the records of a header."""
    values: dict[str, str] = {}
    offsets: dict[str, int] = {}
    for offset, expected in zip(range(0, 3 * RECORD, RECORD), FIRST_KEYWORDS, strict=True):
        keyword, value = _record(content, offset)
        if keyword != expected:
            found = f"{keyword!r}" if len(content) > offset else "the end of the file"
            raise DriveFileError(
                f"the keyword {expected} of an RPC III header was expected; it is {found}.",
                path=path,
                offset=min(offset, len(content)),
            )
        values[keyword], offsets[keyword] = value, offset
    start = Header(path, values, offsets, size=3 * RECORD)
    if values["FORMAT"].upper() not in _BYTE_ORDERS:
        raise start.error("FORMAT", " or ".join(_BYTE_ORDERS))
    blocks = start.integer("NUM_HEADER_BLOCKS", smallest=1, largest=MOST_BLOCKS)
    parameters = start.integer("NUM_PARAMS", smallest=3, largest=blocks * BLOCK // RECORD)
    size = blocks * BLOCK
    if len(content) < size:
        raise DriveFileError(
            f"the file ends within its header, which has {blocks} blocks = {size} bytes.",
            path=path,
            offset=len(content),
        )
    for offset in range(3 * RECORD, parameters * RECORD, RECORD):
        keyword, value = _record(content, offset)
        # Some writers leave empty records between; of a repeated keyword, the first record counts.
        if keyword and keyword not in values:
            values[keyword], offsets[keyword] = value, offset
    return Header(path, values, offsets, size=size)


def _record(content: bytes, offset: int) -> tuple[str, str]:
    """Return keyword and value; bytes after the first NUL are left over from the writer's memory."""
    record = content[offset : offset + RECORD]
    keyword, value = record[:KEYWORD].partition(b"\0")[0], record[KEYWORD:].partition(b"\0")[0]
    return keyword.decode("latin-1").strip().upper(), value.decode("latin-1").strip()


def compose_header(values: Mapping[str, str]) -> bytes:
    """Return a header of these records, in this order, after the three first ones."""
    parameters = len(values) + 2
    blocks = -(-parameters * RECORD // BLOCK)
    first = {"FORMAT": values["FORMAT"], "NUM_HEADER_BLOCKS": str(blocks), "NUM_PARAMS": str(parameters)}
    records = [_composed(keyword, value) for keyword, value in {**first, **values}.items()]
    return b"".join(records).ljust(blocks * BLOCK, b"\0")


def _composed(keyword: str, value: str) -> bytes:
    pieces = []
    for text, room in ((keyword, KEYWORD), (value, RECORD - KEYWORD)):
        try:
            encoded = text.encode("latin-1")
        except UnicodeEncodeError:
            raise ValueError(
                f"{keyword} is {value!r}; an RPC III header holds Latin-1 characters only; rename it."
            ) from None
        if len(encoded) >= room or b"\0" in encoded:
            raise ValueError(f"{keyword} is {value!r}; it must have {room - 1} characters at most, and no NUL.")
        pieces.append(encoded.ljust(room, b"\0"))
    return b"".join(pieces)
