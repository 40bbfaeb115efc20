"""Writer of RPC III time histories: drives and responses, 16-bit integers or 32-bit floating point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from duralab_drive_files.errors import DriveFileError
from duralab_drive_files.rpc3_header import (
    INT_FULL_SCALE,
    TRUE_LENGTH,
    ByteOrder,
    DataType,
    Layout,
    TimeType,
    compose_header,
    stored_type,
)
from duralab_drive_files.time_history import TimeHistory

CHANNELS_ALLOWED: Final = 128
"""Largest number of channels in the description; the reader accepts more."""

_SUFFIX_TIME_TYPES: Final = {".drv": TimeType.DRIVE, ".rsp": TimeType.RESPONSE}
_FORMATS: Final = {ByteOrder.LITTLE: "BINARY_IEEE_LITTLE_END", ByteOrder.BIG: "BINARY_IEEE_BIG_END"}
_KEPT: Final = ("DATE", "OPERATION")
"""Attributes of a read file that are written again; the same applies to those that begin with PARENT_."""


@dataclass(frozen=True)
class Rpc3Settings:
    """Storage settings of a time history.

    Parameters
    ----------
    data_type : DataType
        16-bit integers, which every tool reads, with an error of half a step: 1.5e-5 of the channel's full scale; or
        32-bit floating point, with 6e-8 of the sample.
    time_type : TimeType, optional
        Type of the history; None takes it from the suffix `.drv` or `.rsp`, else from the attribute TIME_TYPE, else
        RESPONSE.
    byte_order : ByteOrder
        Byte order of the samples.
    points_per_frame, points_per_group : int
        Powers of 2 in the ranges of the description: 256 to 16384, and 2048 to 16384.
    half_frames : bool
        Whether the first and the last half frame of the samples are stored as half frames; the samples then are a whole
        number of frames, two or more.

    Raises
    ------
    DriveFileError
        If a value is not allowed.
    """

    data_type: DataType = DataType.SHORT_INTEGER
    time_type: TimeType | None = None
    byte_order: ByteOrder = ByteOrder.LITTLE
    points_per_frame: int = 1024
    points_per_group: int = 2048
    half_frames: bool = False

    def __post_init__(self) -> None:
        for name, value, smallest in (
            ("points_per_frame", self.points_per_frame, 256),
            ("points_per_group", self.points_per_group, 2048),
        ):
            if not (smallest <= value <= 16384 and value.bit_count() == 1):
                raise DriveFileError(
                    f"{name} is {value}; a power of 2 from {smallest} to 16384 is allowed.", field=name
                )
        if self.points_per_group % self.points_per_frame:
            raise DriveFileError(
                f"points_per_group is {self.points_per_group}; it must be a multiple of points_per_frame = "
                f"{self.points_per_frame}.",
                field="points_per_group",
            )


@dataclass(frozen=True)
class WrittenHistory:
    """Result of writing a time history: its padding and the largest errors of the stored samples.

    `padding`: Number of zeros after the samples, because groups are whole. `largest_errors`: For each channel the
    largest difference between a sample and its stored value, in the channel's unit, measured while writing.
    """

    padding: int
    largest_errors: tuple[float, ...]


def write_rpc3(
    history: TimeHistory,
    path: Path,
    settings: Rpc3Settings | None = None,
    *,
    full_scales: Sequence[float] | None = None,
) -> WrittenHistory:
    """Write an RPC III time history.

    Groups are written one after the other, so that memory beside the history is that of one group. The true length is
    in the keyword SAMPLES, which the description does not define: a tool without it reads the padding too.

    Parameters
    ----------
    history : TimeHistory
        History with one channel and one sample or more, all finite.
    path : Path
        Path of the output; an existing file is replaced.
    settings : Rpc3Settings, optional
        Storage settings; 16-bit integers if omitted.
    full_scales : sequence of float, optional
        Largest magnitude that an integer of each channel can hold, in the channel's unit; its peak if omitted.

    Returns
    -------
    WrittenHistory
        Padding and the errors of quantisation.

    Raises
    ------
    DriveFileError
        If the format cannot hold this history, or a sample exceeds its channel's full scale.
    """
    settings = settings or Rpc3Settings()
    count, samples = history.samples.shape
    if count > CHANNELS_ALLOWED:
        raise DriveFileError(f"There are {count} channels; an RPC III file holds {CHANNELS_ALLOWED} at most.")
    if settings.half_frames and (samples < 2 * settings.points_per_frame or samples % settings.points_per_frame):
        raise DriveFileError(
            f"There are {samples} samples; with half frames it must be 2 or more frames of "
            f"{settings.points_per_frame}.",
            field="half_frames",
        )
    layout = Layout(
        channels=count,
        points_per_frame=settings.points_per_frame,
        points_per_group=settings.points_per_group,
        frames=-(-samples // settings.points_per_frame) - settings.half_frames,
        half_frames=settings.half_frames,
        dtype=stored_type(settings.data_type, settings.byte_order),
    )
    lowest, highest = history.samples.min(axis=1), history.samples.max(axis=1)
    peaks = np.maximum(np.abs(lowest), np.abs(highest))
    scales = _scales(peaks if full_scales is None else _checked(full_scales, peaks, history), settings.data_type)
    values = {
        **_about_the_file(history, path, settings, layout),
        **_about_the_channels(history, scales, lowest, highest),
    }
    try:
        header = compose_header(values)
    except ValueError as error:
        # The path is not named: it may be a temporary one.
        raise DriveFileError(str(error)) from error
    largest = _write_groups(path, header, layout, history.samples, scales)
    return WrittenHistory(layout.groups * layout.points_per_group - samples, tuple(largest.tolist()))


def _checked(full_scales: Sequence[float], peaks: np.ndarray, history: TimeHistory) -> np.ndarray:
    scales = np.asarray(full_scales, dtype=np.float64)
    for row in np.flatnonzero(peaks > scales):
        name, unit = history.names[row], history.units[row]
        raise DriveFileError(
            f"{name} reaches {peaks[row]:.6g} {unit}; its full scale is {scales[row]:.6g} {unit}, lower the drive."
        )
    return scales


def _scales(peaks: np.ndarray, data_type: DataType) -> np.ndarray:
    """Return the value of one stored number for these full scales; any value for a silent channel."""
    if data_type is DataType.FLOATING_POINT:
        return np.ones(peaks.size)
    scales = peaks / INT_FULL_SCALE
    # A peak of a few denormals has no full scale that a float can express.
    return np.where(scales >= np.finfo(np.float64).tiny, scales, 1.0)


def _about_the_file(history: TimeHistory, path: Path, settings: Rpc3Settings, layout: Layout) -> dict[str, str]:
    attributes = history.attributes
    kept = {key: text for key, text in attributes.items() if text and (key in _KEPT or key.startswith("PARENT_"))}
    return {
        "FORMAT": _FORMATS[settings.byte_order],
        "FILE_TYPE": "TIME_HISTORY",
        "TIME_TYPE": (settings.time_type or _time_type(attributes.get("TIME_TYPE", ""), path)).value,
        "DATA_TYPE": settings.data_type.value,
        "DELTA_T": repr(1 / float(history.sample_rate)),
        "PTS_PER_FRAME": str(layout.points_per_frame),
        "PTS_PER_GROUP": str(layout.points_per_group),
        "CHANNELS": str(layout.channels),
        "FRAMES": str(layout.frames),
        "HALF_FRAMES": str(int(layout.half_frames)),
        "REPEATS": "1",
        "BYPASS_FILTER": "0",
        "INT_FULL_SCALE": str(INT_FULL_SCALE),
        "PARTITIONS": "1",
        "PART.CHAN_1": "1",
        "PART.NCHAN_1": str(layout.channels),
        TRUE_LENGTH: str(history.samples.shape[1]),
        "OPERATION": "duralab",
        **kept,
    }


def _time_type(attribute: str, path: Path) -> TimeType:
    """Return the type of the suffix; an attribute counts if it agrees with the suffix, or the suffix has no type."""
    by_suffix = _SUFFIX_TIME_TYPES.get(path.suffix.lower())
    known = [kind for kind in TimeType if kind.value == attribute.upper() and kind is not TimeType.PEAK_PICK]
    if known and (by_suffix is None or _is_drive(known[0]) == _is_drive(by_suffix)):
        return known[0]
    return by_suffix or TimeType.RESPONSE


def _is_drive(kind: TimeType) -> bool:
    return kind in {TimeType.DRIVE, TimeType.MULT_DRIVE, TimeType.CONFIG_DRIVE}


def _about_the_channels(
    history: TimeHistory, scales: np.ndarray, lowest: np.ndarray, highest: np.ndarray
) -> dict[str, str]:
    values: dict[str, str] = {}
    for row, (name, unit) in enumerate(zip(history.names, history.units, strict=True)):
        for keyword, value in (
            ("DESC", name),
            ("UNITS", unit),
            ("SCALE", repr(float(scales[row]))),
            ("UPPER_LIMIT", repr(float(highest[row]))),
            ("LOWER_LIMIT", repr(float(lowest[row]))),
            ("MAP", str(row + 1)),
        ):
            values[f"{keyword}.CHAN_{row + 1}"] = value
    return values


def _write_groups(path: Path, header: bytes, layout: Layout, samples: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Write header and groups; return the largest difference of each channel between given and stored samples."""
    largest = np.zeros(layout.channels)
    factors = scales[:, np.newaxis]
    with path.open("wb") as stream:
        stream.write(header)
        for first in range(0, samples.shape[1], layout.points_per_group):
            given = samples[:, first : first + layout.points_per_group]
            group = np.zeros((layout.channels, layout.points_per_group), dtype=layout.dtype)
            stored = group[:, : given.shape[1]]
            if layout.dtype.kind == "i":
                stored[:] = np.rint(given / factors)
            else:
                if np.abs(given).max() > (limit := float(np.finfo(np.float32).max)):
                    raise DriveFileError(
                        f"A sample is {np.abs(given).max():g}; 32-bit floating point holds {limit:g} at most."
                    )
                stored[:] = given
            np.maximum(largest, np.abs(stored * factors - given).max(axis=1), out=largest)
            stream.write(group.tobytes())
    return largest
