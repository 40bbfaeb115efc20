"""What the samples of an RPC III time history are and where they lie."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np


class DataType(StrEnum):
    """How samples are stored."""

    SHORT_INTEGER = "SHORT_INTEGER"
    FLOATING_POINT = "FLOATING_POINT"


class TimeType(StrEnum):
    """What a time history is; the old numbers of the description are its positions, from 1."""

    DRIVE = "DRIVE"
    RESPONSE = "RESPONSE"
    MULT_DRIVE = "MULT_DRIVE"
    MULT_RESP = "MULT_RESP"
    CONFIG_DRIVE = "CONFIG_DRIVE"
    CONFIG_RESP = "CONFIG_RESP"
    PEAK_PICK = "PEAK_PICK"


class ByteOrder(StrEnum):
    """Byte order of the samples, as numpy writes it."""

    LITTLE = "<"
    BIG = ">"


_CODES: Final = {DataType.SHORT_INTEGER: "i2", DataType.FLOATING_POINT: "f4"}


def stored_type(data_type: DataType, order: ByteOrder) -> np.dtype:
    """Return how numpy names a stored sample."""
    return np.dtype(order.value + _CODES[data_type])


@dataclass(frozen=True)
class Layout:
    """Where the samples of a time history lie.

    Data are demultiplexed by groups: all points of a group of the first channel, then of the second, and so on.

    `channels`: 1 or more. `points_per_frame`, `points_per_group`: A group is a whole number of frames. `frames`: Frames
    of data, without the half frames at both ends. `half_frames`: Half a frame more at the start and at the end.
    `dtype`: Of one sample in the file.
    """

    channels: int
    points_per_frame: int
    points_per_group: int
    frames: int
    half_frames: bool
    dtype: np.dtype

    @property
    def points(self) -> int:
        """Points of each channel that the frames count."""
        return (self.frames + self.half_frames) * self.points_per_frame

    @property
    def groups(self) -> int:
        """Groups, the last of which may be padded."""
        return -(-self.points // self.points_per_group)

    @property
    def group_bytes(self) -> int:
        """Bytes of a group of all channels."""
        return self.channels * self.points_per_group * self.dtype.itemsize

    @property
    def data_bytes(self) -> int:
        """Bytes of all groups."""
        return self.groups * self.group_bytes
