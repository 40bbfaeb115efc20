"""Reader of RPC III time histories: `.rsp`, `.drv`, `.tim`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from duralab_drive_files.errors import DriveFileError, opened, require_file
from duralab_drive_files.rpc3_header import (
    BLOCK,
    MOST_BLOCKS,
    RECORD,
    TRUE_LENGTH,
    DataType,
    Header,
    Layout,
    TimeType,
    parse_header,
)
from duralab_drive_files.time_history import TimeHistory, unique_names

PIECE_BYTES: Final = 1 << 18
"""Size in bytes of the part of the file in memory; small enough for the cache of a processor."""

PADDING_ATTRIBUTE: Final = "duralab.padding"
"""Key in `TimeHistory.attributes` of a sentence: whether the padding was cut off or may still be present."""


@dataclass(frozen=True, eq=False)
class Rpc3File:
    """RPC III time history whose header was read and is consistent with the file's size.

    `path`: The file. `header`: All its records. `layout`: Layout of the samples. `names`: Made unique; `labels` and
    `units` as in the file. Limits are ignored, because writers leave them at ±1. `scales`, shape (channels): Value of
    one integer, in the channel's unit; 1 if numbers are stored directly. `sample_rate`: In hertz. `samples`: Number of
    samples of each channel, without padding if the file states its length. `length_known`: False if the last samples
    may be padding. `trailing_bytes`: Number of bytes after the last group, which are not read.
    """

    path: Path
    header: Header
    layout: Layout
    names: tuple[str, ...]
    units: tuple[str, ...]
    labels: tuple[str, ...]
    scales: np.ndarray
    sample_rate: float
    samples: int
    length_known: bool
    trailing_bytes: int

    def read(self) -> np.ndarray:
        """Read the samples."""
        out = np.empty((self.layout.channels, self.samples))
        group = self.layout.points_per_group
        groups_at_once = max(1, PIECE_BYTES // self.layout.group_bytes)
        piece = np.empty((groups_at_once, self.layout.channels, group), dtype=self.layout.dtype)
        with opened(self.path), self.path.open("rb") as stream:
            stream.seek(self.header.size)
            for first in range(0, -(-self.samples // group), groups_at_once):
                groups = piece[: min(groups_at_once, self.layout.groups - first)]
                self._fill(stream, groups, first)
                self._demultiplex(groups, first, out)
        return out

    def _fill(self, stream: BinaryIO, groups: np.ndarray, first: int) -> None:
        content = groups.reshape(-1).view(np.uint8).data
        count = stream.readinto(content)  # pyright: ignore[reportAttributeAccessIssue]
        if count < len(content):
            offset = self.header.size + first * self.layout.group_bytes + count
            raise DriveFileError("the file became shorter while it was read.", path=self.path, offset=offset)

    def _demultiplex(self, groups: np.ndarray, first: int, out: np.ndarray) -> None:
        """Copy groups (group, channel, point) to their position in (channel, sample), in the channels' units."""
        start = first * self.layout.points_per_group
        for position, group in enumerate(groups):
            begin = start + position * self.layout.points_per_group
            points = min(self.layout.points_per_group, self.samples - begin)
            if points <= 0:
                break
            stored, place = group[:, :points], out[:, begin : begin + points]
            if self.layout.dtype.kind == "i":
                np.multiply(stored, self.scales[:, np.newaxis], out=place)
            else:
                # Damaged data may be a signalling NaN; it is refused below.
                with np.errstate(invalid="ignore"):
                    np.copyto(place, stored)
                if not np.isfinite(place).all():
                    self._refuse(place, first + position)

    def _refuse(self, place: np.ndarray, group: int) -> None:
        row, point = (int(index) for index in np.argwhere(~np.isfinite(place))[0])
        layout = self.layout
        offset = self.header.size + group * layout.group_bytes
        offset += (row * layout.points_per_group + point) * layout.dtype.itemsize
        raise DriveFileError(
            f"sample {group * layout.points_per_group + point} of {self.names[row]} is {place[row, point]}; a "
            "finite number was expected.",
            path=self.path,
            offset=offset,
        )

    @property
    def attributes(self) -> dict[str, str]:
        """All records of the header as stored, and a sentence about the padding."""
        if self.length_known:
            padding = self.layout.points - self.samples
            said = f"{padding} samples of padding at the end were cut off, as {TRUE_LENGTH} says"
        else:
            said = "the file does not say where its data end; the last samples may be padding"
        attributes = {**self.header.values, PADDING_ATTRIBUTE: said}
        if self.trailing_bytes:
            attributes["duralab.trailing_bytes"] = f"{self.trailing_bytes} bytes after the data were not read"
        return attributes


def open_rpc3(path: Path) -> Rpc3File:
    """Read and check the header of an RPC III time history.

    Deviations of real writers are accepted: keywords outside the description, lower case, blanks at the ends, more
    header blocks than records, Latin-1, bytes after the data. Anything that makes the samples ambiguous is refused.

    Parameters
    ----------
    path : Path
        Path of a regular file.

    Returns
    -------
    Rpc3File
        File with its header; `read` reads the samples.

    Raises
    ------
    DriveFileError
        With the byte and the expected content.
    """
    size = require_file(path)
    with opened(path), path.open("rb") as stream:
        content = stream.read(BLOCK)
        # The number of blocks is checked before the blocks are read.
        announced = content[RECORD + 32 : 2 * RECORD].partition(b"\0")[0].strip()
        if announced.isdigit() and len(announced) < 6 and 1 < int(announced) <= MOST_BLOCKS:
            content += stream.read((int(announced) - 1) * BLOCK)
    header = parse_header(path, content)
    time_type = header.choice("TIME_TYPE", TimeType, TimeType.RESPONSE)
    if time_type is TimeType.PEAK_PICK:
        raise header.error("TIME_TYPE", "a history of evenly spaced samples, so no picked peaks,")
    layout = header.layout()
    if layout.points == 0:
        raise header.error("FRAMES", "1 frame or more")
    available = size - header.size
    if available < layout.data_bytes:
        raise DriveFileError(
            f"the file ends here; {layout.groups} groups of {layout.channels} channels and {layout.points_per_group} "
            f"points need {layout.data_bytes} bytes after the header, and {available} are there; save or copy it "
            "again.",
            path=path,
            offset=size,
        )
    labels = _texts(header, "DESC", layout.channels)
    samples = header.integer(TRUE_LENGTH, smallest=1, largest=layout.points, default=layout.points)
    return Rpc3File(
        path=path,
        header=header,
        layout=layout,
        names=tuple(unique_names(labels)),
        units=_texts(header, "UNITS", layout.channels),
        labels=labels,
        scales=_scales(header, layout),
        sample_rate=header.sample_rate(),
        samples=samples,
        length_known=TRUE_LENGTH in header.values,
        trailing_bytes=available - layout.data_bytes,
    )


def _texts(header: Header, keyword: str, count: int) -> tuple[str, ...]:
    return tuple(header.values.get(f"{keyword}.CHAN_{number}", "") for number in range(1, count + 1))


def _scales(header: Header, layout: Layout) -> np.ndarray:
    scales = np.ones(layout.channels)
    if header.choice("DATA_TYPE", DataType, DataType.SHORT_INTEGER) is DataType.SHORT_INTEGER:
        for row in range(layout.channels):
            scale = header.real(f"SCALE.CHAN_{row + 1}", "what one integer is worth")
            if scale == 0.0:
                raise header.error(
                    f"SCALE.CHAN_{row + 1}", "a number other than 0 (0 makes every sample of the channel 0)"
                )
            if not math.isfinite(scale * 2**15):
                raise header.error(f"SCALE.CHAN_{row + 1}", "a value whose full scale is finite")
            scales[row] = scale
    return scales


def read_rpc3(path: Path) -> TimeHistory:
    """Read an RPC III time history.

    Parameters
    ----------
    path : Path
        Path of a regular file: `.rsp`, `.drv`, `.tim`.

    Returns
    -------
    TimeHistory
        All channels in the units of the file; the records of the header are its attributes.

    Raises
    ------
    DriveFileError
        With the byte and the expected content.
    """
    file = open_rpc3(path)
    return TimeHistory(file.names, file.units, file.sample_rate, file.read(), file.attributes, file.labels)
