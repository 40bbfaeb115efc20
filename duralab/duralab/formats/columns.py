"""Common part of the formats: table columns, channel names, sample rates, and checks of read signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from duralab.data import Channel, Signals
from duralab.formats.errors import FormatError
from duralab_drive_files import rate_of_step, unique_names

LARGEST_TIME_STEP_ERROR: Final = 1e-3
"""Largest deviation of a time stamp from an even grid, as a share of the step, beside its rounding."""

COARSEST_DIGIT: Final = 0.1
"""Largest value of the last digit of time stamps whose rounding is accepted, as a share of the step."""


def rate_of_times(path: Path, time: np.ndarray) -> float:
    """Return the sample rate of even time stamps."""
    if time.size < 2:
        raise FormatError(path, f"its number of samples is {time.size}; 2 or more are needed to know the sample rate.")
    step = float(time[-1] - time[0]) / (time.size - 1)
    rate, even = np.inf, False
    if 0 < step < np.inf and np.isfinite(1 / step):
        digit = _last_digit(time)
        error = float(np.abs(time - time[0] - step * np.arange(time.size)).max())
        # Times that are even in all digits were not rounded.
        rounding = digit / (time.size - 1) if error > 1e-3 * digit else 0.0
        rate = rate_of_step(step, resolution=max(1e-9 * step, rounding))
        even = error <= LARGEST_TIME_STEP_ERROR * step or (
            digit <= COARSEST_DIGIT * step and _agree(time - time[0], rate, digit=digit)
        )
    if not even:
        steps = np.diff(time)
        worst = int(np.argmax(np.abs(steps - np.median(steps))))
        raise FormatError(
            path,
            f"the time steps differ: {steps[worst]:g} s follows sample {worst}, {np.median(steps):g} s is usual; "
            "an even time that rises was expected.",
        )
    return rate


def _last_digit(time: np.ndarray) -> float:
    """Return the value in seconds of the last decimal that times were written with; 0 beyond nanoseconds."""
    with np.errstate(over="ignore", invalid="ignore"):
        for decimals in range(10):
            scaled = time * 10.0**decimals
            if (np.abs(scaled - np.rint(scaled)) <= 4 * np.finfo(np.float64).eps * np.abs(scaled)).all():
                return 10.0**-decimals
    return 0.0


def _agree(time: np.ndarray, rate: float, *, digit: float) -> bool:
    """Check whether times are those of a rate, rounded to a digit: the first time exactly, or all of them."""
    # The margins are for the rounding of float64. A whole digit is a step that differs.
    errors = time - np.arange(time.size) / rate
    return bool(np.abs(errors).max() <= 0.5001 * digit or np.ptp(errors) < 0.999 * digit)


LEFT_OUT: Final = "duralab.left_out"
"""Key in `Signals.attributes` of a sentence that names the channels of a file that are not read."""

_SECONDS: Final = ("", "s", "sec", "second", "seconds")


def left_out(names: Sequence[str]) -> dict[str, str]:
    """Return the attribute about channels that are not read; empty without such channels."""
    return {LEFT_OUT: f"Channels that are not real numbers are left out: {', '.join(names)}."} if names else {}


def require_one_time(path: Path, axes: Sequence[tuple[str, str, str]]) -> None:
    """Refuse channels whose axis is not time in seconds, or that start at different times.

    `axes`: Name, unit of the axis, and start of each channel.
    """
    for name, unit, start in axes:
        if unit.strip().lower() not in _SECONDS:
            raise FormatError(
                path,
                f"the axis of {name!r} is {unit!r}; time in seconds was expected, so export the channel over seconds.",
            )
        if start != axes[0][2]:
            raise FormatError(
                path,
                f"{axes[0][0]!r} starts at {axes[0][2]} and {name!r} at {start}; one start for all channels was "
                "expected, so export channels that start together.",
            )


TIME: Final = "time [s]"


def headings(signals: Signals) -> list[str]:
    """Return the columns' headings, time first."""
    return [TIME, *(f"{channel.name} [{channel.unit}]" for channel in signals.channels)]


def named_in_headings(path: Path, given: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the names and the units of the channels in headings, without the time."""
    if not given or given[0].strip() != TIME:
        there = given[0][:60] if given else ""
        raise FormatError(path, f"the first column is {there!r}; {TIME!r} was expected.", offset=0)
    if len(given) < 2:
        raise FormatError(
            path, "there is no column beside the time; one like 'left_vertical [N]' was expected.", offset=0
        )
    names, units = [], []
    for heading in given[1:]:
        name, opened, unit = heading.strip().rpartition("[")
        if not opened or not unit.endswith("]"):
            raise FormatError(
                path, f"the column {heading[:60]!r} names no unit; 'left_vertical [N]' or such was expected.", offset=0
            )
        names.append(name.strip())
        units.append(unit[:-1].strip())
    return names, units


def signals_read(
    path: Path,
    names: Iterable[str],
    units: Sequence[str],
    samples: np.ndarray,
    *,
    time: np.ndarray | None = None,
    sample_rate: float = 0.0,
    attributes: Mapping[str, str] = MappingProxyType({}),
) -> Signals:
    """Return a file's samples as signals, at a sample rate or at times; refuse values that are not finite."""
    names = unique_names(names)
    times = [] if time is None else [("time", time)]
    for name, row in [*times, *zip(names, samples, strict=True)]:
        finite = np.isfinite(row)
        if not finite.all():
            sample = int(np.argmin(finite))
            raise FormatError(path, f"sample {sample} of {name} is {row[sample]}; a finite number was expected.")
    channels = tuple(Channel(name, unit) for name, unit in zip(names, units, strict=True))
    rate = sample_rate if time is None else rate_of_times(path, time)
    return Signals(channels, rate, np.ascontiguousarray(samples, dtype=np.float64), attributes)


def one_step(path: Path, what: str, found: Iterable[tuple[float, int]], *, step_name: str = "time step") -> float:
    """Return the common time step in seconds; `found` holds the step and the length of each channel."""
    steps = set(found)
    if len(steps) != 1:
        raise FormatError(
            path,
            f"{what} have the steps and lengths {sorted(steps)[:4]}; one {step_name} in seconds and one length for all "
            "were expected.",
        )
    ((step, length),) = steps
    if not (0 < step < np.inf and np.isfinite(1 / step) and length):
        raise FormatError(path, f"the {step_name} is {step} s with {length} samples; both must be greater than 0.")
    return step
