"""Universal files, dataset 58: time histories, and frequency responses.

pyuff reads the text form and the binary one (58b). This module writes the binary form, which keeps float64: pyuff's
writer stores a wrong size and converts values that are not finite to numbers. The header has six digits for the time
step.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.data import Channel, Signals
from duralab.errors import InputError
from duralab.formats.columns import one_step, require_one_time, signals_read
from duralab.formats.errors import FormatError, Written, require_file
from duralab.formats.libraries import parsing, require_library
from duralab_drive_files import rate_of_step


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Frequency response matrix: `frf` in y(f) = frf(f) u(f), with e^{+jωt}.

    Parameters
    ----------
    drives, responses : tuple of Channel
        Inputs and outputs.
    frequency : np.ndarray, shape (lines)
        Frequency lines in hertz, evenly spaced.
    frf : np.ndarray, shape (lines, responses, drives)
        Complex, response unit per drive unit.
    """

    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    frequency: np.ndarray
    frf: np.ndarray


TIME_RESPONSE: Final = 1
FREQUENCY_RESPONSE: Final = 4
EVEN: Final = 1
_TIME_AXIS, _FREQUENCY_AXIS, _GENERAL, _UNKNOWN = 17, 18, 1, 0
_DOUBLE, _COMPLEX_DOUBLE = 4, 6
_LITTLE_ENDIAN, _IEEE, _HEADER_LINES = 1, 2, 11
_NAME_ROOM, _UNIT_ROOM = 80, 20
_STEP_DIGITS: Final = 5.1e-6
"""Relative resolution of the header's time step (E13.5): half of the sixth digit, at the smallest mantissa."""

_EXPECTED: Final = "a universal file with datasets 58"
_PAIR: Final = re.compile(r"(.+) per (.+)")
_DELIMITER: Final = re.compile(rb" {4}-1(?=[\r\n]| {74}|\Z)")
"""Line that opens or closes a dataset, by the rule of pyuff."""


def read_uff58(path: Path) -> Signals:
    """Read the time histories of a universal file."""
    sets = _sets(path, TIME_RESPONSE, "time history")
    step = one_step(path, "its time histories", ((float(one["abscissa_inc"]), len(one["data"])) for one in sets))
    names, units = zip(*((_text(one["id1"]), _text(one.get("ordinate_axis_units_lab"))) for one in sets), strict=True)
    require_one_time(
        path, [(name, _axis(one), f"{float(one['abscissa_min'])} s") for name, one in zip(names, sets, strict=True)]
    )
    for name, one in zip(names, sets, strict=True):
        if np.iscomplexobj(one["data"]):
            raise FormatError(
                path, f"the samples of {name!r} are complex; real ones were expected, so export a real time history."
            )
    samples = np.array([one["data"] for one in sets], dtype=np.float64)
    return signals_read(path, names, units, samples, sample_rate=rate_of_step(step, resolution=_STEP_DIGITS * step))


def write_uff58(signals: Signals, path: Path) -> Written:
    """Write time histories as datasets 58b of float64."""
    step = 1 / signals.sample_rate
    sets = [
        _dataset(channel.name, row, function=TIME_RESPONSE, step=step, start=0.0, ordinate=channel.unit, place=place)
        for place, (channel, row) in enumerate(zip(signals.channels, signals.samples, strict=True), start=1)
    ]
    path.write_bytes(b"".join(sets))
    notes = ["UFF 58 keeps no attributes."] if signals.attributes else []
    kept = rate_of_step(float(f"{step:.5e}"), resolution=_STEP_DIGITS * step)
    if kept != signals.sample_rate:
        notes.append(f"The time step has six digits in UFF 58, so that {signals.sample_rate} Hz become {kept} Hz.")
    return Written(path, "uff58", signals.samples.shape[1], 0, (0.0,) * len(sets), tuple(notes))


def write_frequency_response(response: FrequencyResponse, path: Path) -> None:
    """Write a frequency response matrix, one dataset 58b of complex float64 for each response and drive.

    Parameters
    ----------
    response : FrequencyResponse
        Finite frequency responses at evenly spaced frequencies.
    path : Path
        Path of the output; an existing file is replaced.

    Raises
    ------
    InputError
        A number is not finite, the frequencies are not even, or a name does not fit.
    """
    unknown = response.frequency[~np.isfinite(response.frf).all(axis=(1, 2))]
    if unknown.size or response.frequency.size < 2:
        first = f", the first at {unknown[0]:g} Hz" if unknown.size else ""
        raise InputError(
            f"{unknown.size} of {response.frequency.size} lines of the frequency response were not identified{first}; "
            "to write UFF 58, 2 lines or more are needed, all of them identified."
        )
    step = float(response.frequency[-1] - response.frequency[0]) / (response.frequency.size - 1)
    grid = response.frequency[0] + step * np.arange(response.frequency.size)
    if not np.allclose(response.frequency, grid, rtol=0, atol=1e-6 * step):
        raise InputError("The frequencies are not evenly spaced; this writer of UFF 58 stores even ones only.")
    sets = [
        _dataset(
            f"{output.name} per {drive.name}",
            response.frf[:, row, column],
            function=FREQUENCY_RESPONSE,
            step=step,
            start=float(response.frequency[0]),
            ordinate=output.unit,
            denominator=drive.unit,
            place=row + 1,
            reference=column + 1,
        )
        for row, output in enumerate(response.responses)
        for column, drive in enumerate(response.drives)
    ]
    path.write_bytes(b"".join(sets))


def read_frequency_response(path: str | Path) -> FrequencyResponse:
    """Read a frequency response matrix.

    Parameters
    ----------
    path : str or Path
        File with a dataset 58 of function type 4 for each response and drive, named "<response> per <drive>" in ID
        line 1.

    Returns
    -------
    FrequencyResponse
        Responses and drives in the order of the file.

    Raises
    ------
    FormatError
        The file has no FRF, the FRFs have different frequencies, or an FRF of the matrix is missing.
    """
    path = Path(path)
    columns: dict[tuple[str, str], np.ndarray] = {}
    drives: dict[str, Channel] = {}
    responses: dict[str, Channel] = {}
    axes = set()
    for one in _sets(path, FREQUENCY_RESPONSE, "frequency response"):
        name = _text(one["id1"])
        pair = _PAIR.fullmatch(name)
        if pair is None:
            raise FormatError(path, f"a frequency response is called {name!r}; '<response> per <drive>' was expected.")
        responses.setdefault(pair[1], Channel(pair[1], _text(one.get("ordinate_axis_units_lab"))))
        drives.setdefault(pair[2], Channel(pair[2], _text(one.get("orddenom_axis_units_lab"))))
        columns[pair[1], pair[2]] = np.asarray(one["data"], dtype=np.complex128)
        axes.add((float(one["abscissa_min"]), float(one["abscissa_inc"]), len(one["data"])))
    if len(axes) > 1 or len(columns) != len(responses) * len(drives):
        raise FormatError(
            path,
            f"{len(columns)} frequency responses at {len(axes)} sets of frequencies; one for each of {len(responses)} "
            f"responses and {len(drives)} drives, at the same, was expected.",
        )
    ((start, step, lines),) = axes
    frf = np.array([[columns[output, drive] for drive in drives] for output in responses])
    return FrequencyResponse(
        tuple(drives.values()),
        tuple(responses.values()),
        start + step * np.arange(lines),
        np.ascontiguousarray(frf.transpose(2, 0, 1)),
    )


def _sets(path: Path, function: int, kind: str) -> list[dict[str, Any]]:
    pyuff = require_library("pyuff", extra="uff")
    size = require_file(path)
    with parsing(path, _EXPECTED) as stream:
        # pyuff ignores a dataset that is not closed.
        if sum(1 for _ in _DELIMITER.finditer(stream.read())) % 2:
            raise FormatError(
                path, "the last dataset is not closed by a line '-1'; copy or save the file again.", offset=size
            )
        file = pyuff.UFF(str(path))
        chosen = []
        for number, dataset in enumerate(file.get_set_types()):
            if dataset == 58:
                content = file.read_sets(number)
                if content["func_type"] == function:
                    _require_even(path, content, place=number + 1)
                    chosen.append(content)
    if not chosen:
        raise FormatError(path, f"it holds no {kind}; datasets 58 of function type {function} were expected.", offset=0)
    return chosen


def _axis(content: dict[str, Any]) -> str:
    """Return the unit of the abscissa, or its type if the type is known and not time."""
    kind = content["abscissa_spec_data_type"]
    unit = _text(content.get("abscissa_axis_units_lab"))
    return unit if kind in {_TIME_AXIS, _GENERAL, _UNKNOWN} else f"{unit} (type {kind})".strip()


def _require_even(path: Path, content: dict[str, Any], *, place: int) -> None:
    if content["abscissa_spacing"] != EVEN:
        raise FormatError(path, f"dataset {place} is not evenly spaced; an even abscissa was expected.")
    announced, there = content["num_pts"], len(content["data"])
    if announced != there:
        raise FormatError(
            path, f"dataset {place} announces {announced} values and holds {there}; as many as announced were expected."
        )


def _dataset(
    name: str,
    data: np.ndarray,
    *,
    function: int,
    step: float,
    start: float,
    ordinate: str,
    place: int,
    denominator: str = "",
    reference: int = 0,
) -> bytes:
    for text, room in ((name, _NAME_ROOM), (ordinate, _UNIT_ROOM), (denominator, _UNIT_ROOM)):
        if len(text) > room or not text.isascii() or not (text.isprintable() or not text):
            raise InputError(f"{text!r} does not fit into UFF 58; {room} ASCII characters at most are allowed.")
    time = function == TIME_RESPONSE
    numbers = np.ascontiguousarray(data, dtype="<f8" if time else "<c16")
    axes = (
        (_TIME_AXIS if time else _FREQUENCY_AXIS, "s" if time else "Hz"),
        (_GENERAL, ordinate),
        (0 if time else _GENERAL, denominator),
        (0, ""),
    )
    lines = [
        f"{-1:6d}",
        f"{58:6d}b{_LITTLE_ENDIAN:6d}{_IEEE:6d}{_HEADER_LINES:12d}{numbers.nbytes:12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(f"{text:<80}" for text in (name or "NONE", "NONE", "NONE", "NONE", "NONE")),
        f"{function:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{place:10d}{0:4d} {'NONE':<10}{reference:10d}{0:4d}",
        f"{_DOUBLE if time else _COMPLEX_DOUBLE:10d}{numbers.size:10d}{EVEN:10d}{start:13.5e}{step:13.5e}{0.0:13.5e}",
        *(f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit or 'NONE':<20}" for kind, unit in axes),
    ]
    return "\n".join(lines).encode("ascii") + b"\n" + numbers.tobytes() + f"\n{-1:6d}\n".encode("ascii")


def _text(value: object) -> str:
    text = str(value or "").strip()
    return "" if text.upper() == "NONE" else text
