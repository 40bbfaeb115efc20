"""Reader of OpenCRG road files, text and binary."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from duralab_roads.road import Road

MAXIMUM_HEADER_BYTES = 4_000_000
MAXIMUM_LINE_BYTES = 4096

LATERAL_POSITION = re.compile(r"^long section at v\s*=\s*(\S+)$")


class RoadFileError(ValueError):
    """Road file that cannot be read; the message names the file, the byte offset and the expected content.

    Parameters
    ----------
    path
        Path of the file; its name is in the message.
    offset
        Byte with the error, from 0.
    sentence
        Found value, and expected value.
    """

    def __init__(self, path: Path, offset: int, sentence: str) -> None:
        super().__init__(f"{path.name}, byte {offset}: {sentence}")
        self.offset = offset


class CrgFormat(Enum):
    """Data formats: width of a number [bytes], numbers per 80-byte record, text or big-endian binary."""

    LRFI = (10, 8, True)
    LDFI = (20, 4, True)
    KRBI = (4, 20, False)
    KDBI = (8, 10, False)

    def __init__(self, width: int, per_record: int, is_text: bool) -> None:
        self.width = width
        self.per_record = per_record
        self.is_text = is_text


@dataclass(frozen=True)
class CrgHeader:
    """Header of a file: the $ROAD_CRG block and the data channels, named in lower case, values in SI units."""

    path: Path
    parameters: dict[str, float]
    channels: tuple[str, ...]
    data_format: CrgFormat
    data_offset: int

    def error(self, sentence: str) -> RoadFileError:
        """Return the error for the data after the header."""
        return RoadFileError(self.path, self.data_offset, sentence)


def read_header(stream: BinaryIO, path: Path) -> CrgHeader:
    """Read up to and including the line of `$$$$` that separates header and data."""
    parameters: dict[str, float] = {}
    channels: list[str] = []
    data_format: CrgFormat | None = None
    block = ""
    offset = 0
    while True:
        raw = stream.readline(MAXIMUM_LINE_BYTES)
        if not raw.endswith(b"\n") or offset > MAXIMUM_HEADER_BYTES:
            raise RoadFileError(
                path, offset, "expected a header that ends in a line of $$$$; this is no whole OpenCRG file."
            )
        if raw.startswith(b"$$$$"):
            break
        line = raw.decode("latin-1").split("!")[0].strip()
        if line.startswith("$"):
            block = line[1:].strip().upper()
        elif line and not line.startswith("*"):
            if block == "ROAD_CRG":
                name, value = _assignment(line, path=path, offset=offset)
                parameters[name] = value
            elif block == "KD_DEFINITION":
                data_format = _definition(line, channels, data_format, path=path, offset=offset)
            elif block in ("ROAD_CRG_MODS", "ROAD_CRG_FILE"):
                raise RoadFileError(
                    path,
                    offset,
                    f"block ${block} is not supported; apply it with the OpenCRG tools and save the result.",
                )
        offset += len(raw)
    if data_format is None or not channels:
        raise RoadFileError(path, offset, "expected a block $KD_DEFINITION with a format (#:) and data channels (D:).")
    return CrgHeader(path, parameters, tuple(channels), data_format, offset + len(raw))


def _assignment(line: str, *, path: Path, offset: int) -> tuple[str, float]:
    name, equals, text = line.partition("=")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not equals or not math.isfinite(value):
        raise RoadFileError(path, offset, f"expected NAME = finite number in $ROAD_CRG, found {line[:60]!r}.")
    return name.strip().lower(), value


def _definition(
    line: str, channels: list[str], data_format: CrgFormat | None, *, path: Path, offset: int
) -> CrgFormat | None:
    kind, _, text = line.partition(":")
    if kind == "#":
        if text.strip().upper() not in CrgFormat.__members__:
            raise RoadFileError(
                path,
                offset,
                f"data format {text.strip()[:20]!r} is not supported; expected one of LRFI, LDFI, KRBI, KDBI.",
            )
        return CrgFormat[text.strip().upper()]
    if kind == "D":
        channels.append(" ".join(text.split(",")[0].lower().split()))
    elif kind != "U":
        raise RoadFileError(path, offset, f"expected a line #:, U: or D: in $KD_DEFINITION, found {line[:60]!r}.")
    return data_format


MAXIMUM_STRETCH = 0.1
"""Largest curvature times lateral position at which the grid may be unrolled into a straight road."""

HEADING = "reference line phi"
SLOPE, BANKING = "reference line slope", "reference line banking"


def read_opencrg(path: str | os.PathLike[str], *, maximum_cells: int = 50_000_000) -> Road:
    """Read the elevation grid of an OpenCRG file.

    The curved grid is unrolled: u becomes the distance along the road, regardless of the heading. This stretches a
    track at v by curvature times v, which is allowed up to 10 % at the outermost column.

    Parameters
    ----------
    path
        Path of a file in format LRFI, LDFI, KRBI or KDBI.
    maximum_cells
        Largest accepted number of values in the file; memory is about 8 bytes each.

    Returns
    -------
    Road
        Road with elevation as in the file, NaN where the file has none.

    Raises
    ------
    RoadFileError
        If the file is damaged, shorter or longer than its header states, too large, too curved, has slope or banking of
        the reference line, modifiers or included files, or columns that do not fit the header.
    OSError
        If the file cannot be opened.

    Source: ASAM OpenCRG 1.2.0, file format.
    """
    path = Path(path)
    with path.open("rb") as stream:
        header = read_header(stream, path)
        positions, columns = _lateral_positions(header)
        spacing, rows = _longitudinal(header)
        count = len(header.channels)
        if rows is not None and rows * count > maximum_cells:
            raise header.error(
                f"the header announces {rows} x {count} values, more than the {maximum_cells} that are accepted.",
            )
        if header.data_format.is_text:
            values = _read_text(stream, header, path, rows=rows, maximum_rows=maximum_cells // count)
        else:
            values = _read_binary(stream, header, rows=rows)
    _refuse_inclined(header, values)
    _refuse_curved(header, values, spacing=spacing, outermost=float(np.abs(positions).max()))
    grid = values[:, columns]
    if np.any(np.isinf(grid)):
        raise header.error("expected finite elevations or NaN, found an infinite one.")
    return Road(spacing, positions, grid)


def _longitudinal(header: CrgHeader) -> tuple[float, int | None]:
    """Return the spacing [m] and the number of rows, None if the header does not state it."""
    spacing = header.parameters.get("reference_line_increment")
    if spacing is None or spacing <= 0:
        raise header.error("expected REFERENCE_LINE_INCREMENT above 0 m in $ROAD_CRG.")
    end = header.parameters.get("reference_line_end_u")
    if end is None:
        return spacing, None
    steps = (end - header.parameters.get("reference_line_start_u", 0.0)) / spacing
    if not math.isfinite(steps) or steps < 0.5 or abs(steps - round(steps)) > 1e-3 * max(1.0, steps * 1e-3):
        raise header.error(
            f"expected a whole number of increments from start to end of u, found {steps:.6g}.",
        )
    return spacing, round(steps) + 1


def _lateral_positions(header: CrgHeader) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the ascending positions [m] of the elevation columns and the columns' indices among the channels."""
    columns = [index for index, name in enumerate(header.channels) if name.startswith("long section")]
    if not columns:
        raise header.error("expected data channels named 'long section'.")
    named = [LATERAL_POSITION.match(header.channels[index]) for index in columns]
    if any(named):
        try:
            positions = np.array([float(match.group(1)) if match else math.nan for match in named])
        except ValueError:
            positions = np.array([math.nan])
        order = np.argsort(positions)
    else:
        positions = _regular_positions(header, count=len(columns))
        order = np.arange(len(columns))
    positions = positions[order]
    if not np.all(np.isfinite(positions)) or np.any(np.diff(positions) <= 0):
        raise header.error("expected a different finite lateral position for each long section.")
    return positions, np.array(columns)[order]


def _regular_positions(header: CrgHeader, *, count: int) -> NDArray[np.float64]:
    right = header.parameters.get("long_section_v_right")
    left = header.parameters.get("long_section_v_left")
    increment = header.parameters.get("long_section_v_increment")
    if right is not None and left is None and increment is not None:
        left = right + (count - 1) * increment
    if right is None or left is None or (count > 1 and left <= right):
        raise header.error(
            "expected LONG_SECTION_V_RIGHT below LONG_SECTION_V_LEFT, or 'long section at v ='.",
        )
    positions = np.linspace(right, left, count)
    if increment is not None and abs(right + (count - 1) * increment - left) > 1e-3 * abs(increment):
        raise header.error(
            f"{count} long sections do not reach from v = {right} to {left} m in steps of {increment} m.",
        )
    return positions


def _read_binary(stream: BinaryIO, header: CrgHeader, *, rows: int | None) -> NDArray[np.float64]:
    """Return (rows, channels); records continue across rows, the last one is padded."""
    if rows is None:
        raise header.error("expected REFERENCE_LINE_END_U, which a binary file needs.")
    data_format = header.data_format
    count = rows * len(header.channels)
    available = os.fstat(stream.fileno()).st_size - header.data_offset
    needed = count * data_format.width
    padded = -(-count // data_format.per_record) * data_format.per_record * data_format.width
    if not needed <= available <= padded:
        raise header.error(
            f"expected {needed} bytes of data ({rows} rows of {len(header.channels)} channels, at most {padded} with "
            f"padding), found {available}; the file was cut or its line endings were converted.",
        )
    kind = ">f4" if data_format is CrgFormat.KRBI else ">f8"
    values = np.frombuffer(stream.read(needed), dtype=kind)
    if values.size != count:
        raise header.error("the file became shorter while it was read.")
    return values.astype(np.float64).reshape(rows, len(header.channels))


def _read_text(
    stream: BinaryIO, header: CrgHeader, path: Path, *, rows: int | None, maximum_rows: int
) -> NDArray[np.float64]:
    """Return (rows, channels); each row begins a new line, fields have a fixed width, a star means NaN."""
    width, per_record = header.data_format.width, header.data_format.per_record
    count = len(header.channels)
    offset = header.data_offset
    table: list[NDArray[np.float64]] = []
    row: list[float] = []
    # A line is a record of 80 bytes and its end; a longer one is cut here and fails below.
    while raw := stream.readline(84):
        line = raw.rstrip(b"\r\n ")
        if line or row:
            expected = min(per_record, count - len(row))
            if not (expected - 1) * width < len(line) <= expected * width:
                raise RoadFileError(
                    path,
                    offset,
                    f"expected {expected} numbers of {width} characters, found {line[:40].decode('latin-1')!r}.",
                )
            row += [_number(line[at : at + width], path, offset + at) for at in range(0, expected * width, width)]
        if len(row) == count:
            table.append(np.array(row))
            row = []
            if len(table) > (maximum_rows if rows is None else rows):
                raise RoadFileError(path, offset, f"expected at most {rows or maximum_rows} rows of data, found more.")
        offset += len(raw)
    if row or len(table) != (rows or max(len(table), 2)):
        raise RoadFileError(path, offset, f"expected {rows or 'at least 2'} whole rows of data, found {len(table)}.")
    return np.stack(table)


def _number(field: bytes, path: Path, offset: int) -> float:
    text = field.strip()
    if text.startswith(b"*"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise RoadFileError(path, offset, f"expected a number, found {field.decode('latin-1')!r}.") from None


def _refuse_inclined(header: CrgHeader, values: NDArray[np.float64]) -> None:
    """Refuse slope and banking of the reference line: elevation would be only a part of the height."""
    for name, suffix in ((SLOPE, "s"), (BANKING, "b")):
        ends = [header.parameters.get(f"reference_line_{end}_{suffix}", 0.0) for end in ("start", "end")]
        if name in header.channels:
            column = values[:, header.channels.index(name)]
            ends.append(float(np.nanmax(np.abs(column), initial=0.0)))
        if any(value != 0 for value in ends):
            raise header.error(f"a {name} other than 0 is not supported; add it to the elevations first.")


def _refuse_curved(header: CrgHeader, values: NDArray[np.float64], *, spacing: float, outermost: float) -> None:
    """Refuse a reference line that turns too much to be unrolled (heading over whole metres, against noise)."""
    if HEADING not in header.channels:
        return
    heading = values[:, header.channels.index(HEADING)]
    heading = np.unwrap(heading[np.isfinite(heading)])
    window = min(max(round(1.0 / spacing), 1), heading.size - 1)
    if window < 1:
        return
    curvature = float(np.abs(heading[window:] - heading[:-window]).max()) / (window * spacing)
    stretch = curvature * outermost
    if stretch > MAXIMUM_STRETCH:
        raise header.error(
            f"the reference line turns with {curvature:.3g} rad/m, which stretches the outermost column by "
            f"{100 * stretch:.0f} %; up to {100 * MAXIMUM_STRETCH:.0f} % can be driven as a straight road.",
        )
