"""Limits of the drives in the live view: two lines around each drive, as long as the drawn signal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from duralab_proto.v1 import array_pb2
from recorder.live.series import LIMIT_COLOUR, RUN_TIME, Group, channel_path

_NAMES: Final = ("lower limit", "upper limit")
# A viewer draws no line to a point outside of the shown segment.
_SPACING_SECONDS: Final = 1.0
_MOST_POINTS: Final = 100_000


class DriveLimits:
    """Draws the limits of a rig's drives.

    `stream`: Stream to draw into. `drives`: A drive without two finite limits, the lower one below the upper one, has
    no lines.
    """

    def __init__(self, stream: rr.RecordingStream, drives: Sequence[array_pb2.Channel]) -> None:
        self._stream = stream
        self._drives = [drive for drive in drives if _is_limited(drive)]
        self._end = 0.0
        for drive in self._drives:
            style = rr.SeriesLines(names=_NAMES, colors=[LIMIT_COLOUR] * 2, widths=[1.5, 1.5])
            stream.log(_path(drive), style, static=True)
            self._send(drive, [0.0])

    def reach(self, end: float) -> None:
        """Extend the lines to a time of the run, in seconds; they are never shortened."""
        if end > self._end:
            # A block may claim any time: one point per second, but not more than `_MOST_POINTS`.
            spacing = max(_SPACING_SECONDS, (end - self._end) / _MOST_POINTS)
            between = np.arange(self._end + spacing, end, spacing)
            self._end = end
            for drive in self._drives:
                self._send(drive, [*between, end])

    def _send(self, drive: array_pb2.Channel, times: Sequence[float]) -> None:
        limits = [drive.minimum, drive.maximum] * len(times)
        self._stream.send_columns(
            _path(drive),
            indexes=[rr.TimeColumn(RUN_TIME, duration=times)],
            columns=rr.Scalars.columns(scalars=limits).partition([2] * len(times)),
        )


def _is_limited(drive: array_pb2.Channel) -> bool:
    return math.isfinite(drive.minimum) and math.isfinite(drive.maximum) and drive.minimum < drive.maximum


def _path(drive: array_pb2.Channel) -> str:
    # Curves are drawn in the order of their paths: the digit puts the limits below the drive.
    return f"{channel_path(Group.DRIVE, drive.name)}/" + rr.escape_entity_path_part("0 limits")
