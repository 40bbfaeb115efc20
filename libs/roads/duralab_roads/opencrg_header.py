"""The header of an OpenCRG file: parameters, channels, data format."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import BinaryIO

MAXIMUM_HEADER_BYTES = 4_000_000
MAXIMUM_LINE_BYTES = 4096

LATERAL_POSITION = re.compile(r"^long section at v\s*=\s*(\S+)$")


class RoadFileError(ValueError):
    """A road file cannot be read; the message names the file, the byte offset and what was expected.

    Parameters
    ----------
    path
        The file; its name is in the message.
    offset
        The byte at which it is wrong, from 0.
    sentence
        What is there, and what was expected.
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
    """What the header says.

    `parameters`: The $ROAD_CRG block: names in lower case, values in SI units. `channels`: Names of the data channels
    in file order, lower case, without units. `data_format`: How the numbers are stored. `data_offset`: Byte at which
    they begin.
    """

    parameters: dict[str, float]
    channels: tuple[str, ...]
    data_format: CrgFormat
    data_offset: int


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
    return CrgHeader(parameters, tuple(channels), data_format, offset + len(raw))


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
