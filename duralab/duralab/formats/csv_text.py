"""CSV text: a header line of columns, then one line for each sample."""

from __future__ import annotations

import csv
import re
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from duralab.data import Signals
from duralab.errors import InputError
from duralab.formats.columns import headings, named_in_headings, signals_read
from duralab.formats.errors import FormatError, Written, opened, require_file

# Positions where a spreadsheet, with any separator, may begin a cell and read the text as a formula.
_BEGIN: Final = "(^|[;\t])"
_FORMULA: Final = "(?=[\"']*[=+\\-@\t＝＋－＠])"
_UNGUARDED: Final = re.compile(_BEGIN + _FORMULA)
_GUARDED: Final = re.compile(f"{_BEGIN}'{_FORMULA}")
_SEPARATOR: Final = re.compile(r'"?time \[s\]"?[ ]*([,;\t])')
_ROWS_AT_ONCE: Final = 10_000
_LONGEST_LINE: Final = 1 << 20


def read_csv(path: Path) -> Signals:
    """Read CSV text: "time [s]", then "<name> [<unit>]" for each channel, separated by comma, semicolon or tab."""
    require_file(path)
    row: list[str] = []
    try:
        with opened(path), path.open(encoding="utf-8-sig", newline="") as stream:
            header = stream.readline(_LONGEST_LINE)
            # Detect the separator after the time heading: a name may contain another separator more often.
            named = _SEPARATOR.match(header)
            separator = named[1] if named else max(",;\t", key=header.count)
            cells = next(csv.reader([header], delimiter=separator, strict=True), [])
            row = [_GUARDED.sub(r"\1", cell) for cell in cells]
            names, units = named_in_headings(path, row)
            first = stream.readline(_LONGEST_LINE)
            if not first.strip():
                raise FormatError(path, "no samples follow the header line; 2 or more were expected.")
            values = np.loadtxt(chain([first], stream), delimiter=separator, comments=None, ndmin=2, dtype=np.float64)
    except UnicodeDecodeError as error:
        raise FormatError(path, f"this is no UTF-8 text ({error.reason}).", offset=_undecodable(path)) from error
    except csv.Error as error:
        raise FormatError(
            path, f"the header line is no CSV ({error}); correct its quotes and separators.", offset=0
        ) from error
    except ValueError as error:
        line = _line(str(error))
        raise FormatError(
            path,
            f"line {line}: {len(row)} numbers with decimal points were expected ({_reason(str(error))}).",
            offset=_start_of(path, line),
        ) from error
    if values.shape[1] != len(row):
        raise FormatError(path, f"line 2: {len(row)} numbers were expected; {values.shape[1]} are there.", offset=0)
    return signals_read(path, names, units, values.T[1:], time=values.T[0])


def _line(message: str) -> int:
    """Return the line, from 1, of an error of numpy, which counts rows after the header from 0 or 1."""
    found = re.search(r"at row (\d+)", message)
    if found is None:
        return 2
    return int(found[1]) + (1 if "changed" in message else 2)


def _reason(message: str) -> str:
    """Return an error of numpy without the advice on its arguments."""
    found = re.search(r"changed from (\d+) to (\d+)", message)
    return message if found is None else f"this line has {found[2]}, the lines before have {found[1]}"


def _start_of(path: Path, line: int) -> int:
    with path.open("rb") as stream:
        for _ in range(line - 1):
            stream.readline()
        return stream.tell()


def _undecodable(path: Path) -> int:
    offset = 0
    with path.open("rb") as stream:
        for line in stream:
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                return offset + error.start
            offset += len(line)
    return offset


def write_csv(signals: Signals, path: Path) -> Written:
    """Write CSV text; numbers have enough digits to restore the same float64.

    A name that a spreadsheet would run as a formula gets a leading single quote (CSV injection, OWASP), which
    `read_csv` removes: rigs and foreign files may use any channel name.
    """
    for channel in signals.channels:
        if set(channel.name + channel.unit) & {"\n", "\r"}:
            raise InputError(
                f"The channel {channel.name!r} in {channel.unit!r} has a line break, which a header of CSV does not "
                "hold; rename it, or write another format."
            )
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([_UNGUARDED.sub(r"\1'", heading) for heading in headings(signals)])
        for first in range(0, signals.samples.shape[1], _ROWS_AT_ONCE):
            piece = signals.samples[:, first : first + _ROWS_AT_ONCE]
            time = (first + np.arange(piece.shape[1])) / signals.sample_rate
            writer.writerows(np.vstack([time, piece]).T.tolist())
    notes = ("CSV keeps no attributes.",) if signals.attributes else ()
    return Written(path, "csv", signals.samples.shape[1], 0, (0.0,) * len(signals.channels), notes)
