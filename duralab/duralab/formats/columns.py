"""Columns of a table: "time [s]", then "<name> [<unit>]" for each channel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from duralab.data import Channel, Signals
from duralab.formats.channel_names import unique_names
from duralab.formats.errors import FormatError
from duralab.formats.sample_rates import rate_of_times

TIME: Final = "time [s]"


def headings(signals: Signals) -> list[str]:
    """Return the columns' headings, time first."""
    return [TIME, *(f"{channel.name} [{channel.unit}]" for channel in signals.channels)]


def channels_of_headings(path: Path, given: Sequence[str]) -> tuple[Channel, ...]:
    """Return the channels that headings name, without the time."""
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
    return tuple(Channel(name, unit) for name, unit in zip(unique_names(names), units, strict=True))


def signals_of_columns(path: Path, channels: tuple[Channel, ...], values: np.ndarray) -> Signals:
    """Return the signals of a table."""
    require_finite(path, ("time", *(channel.name for channel in channels)), values)
    return Signals(channels, rate_of_times(path, values[0]), np.ascontiguousarray(values[1:], dtype=np.float64))


def require_finite(path: Path, names: Sequence[str], values: np.ndarray) -> None:
    """Refuse values that are not finite."""
    for name, row in zip(names, values, strict=True):
        finite = np.isfinite(row)
        if not finite.all():
            sample = int(np.argmin(finite))
            raise FormatError(path, f"sample {sample} of {name} is {row[sample]}; a finite number was expected.")
