"""MDF 4 measurements by asammdf."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.data import Signals
from duralab.formats.columns import left_out, signals_read
from duralab.formats.errors import FormatError, Written, require_file
from duralab.formats.libraries import parsing, require_library, require_room

_EXPECTED: Final = "an MDF 4 measurement"


def read_mdf4(path: Path) -> Signals:
    """Read an MDF 4 measurement."""
    asammdf = require_library("asammdf", extra="mdf")
    require_file(path)
    # If asammdf opens a damaged file, it prints tracebacks to standard error; so it gets an open stream.
    with parsing(path, _EXPECTED) as stream, io.BufferedReader(stream) as buffered:
        if buffered.read(8) not in (b"MDF     ", b"UnFinMF "):
            raise FormatError(path, "the file does not begin with 'MDF'; an MDF 4 measurement was expected.", offset=0)
        buffered.seek(0)
        with asammdf.MDF(buffered) as measurement:
            if measurement.version < "4.00":
                raise FormatError(path, f"it is MDF {measurement.version}; MDF 4 was expected.", offset=8)
            require_room(
                path, sum(int(group.channel_group.cycles_nr) * len(group.channels) for group in measurement.groups)
            )
            signals = [
                signal
                for number in measurement.virtual_groups
                for signal in measurement.select(
                    [(None, group, index) for group, index in _members(measurement, number)], copy_master=False
                )
            ]
    found = [signal for signal in signals if _is_numbers(signal)]
    if not found:
        raise FormatError(path, "it holds no channel of numbers; one or more were expected.")
    for signal in found:
        if signal.invalidation_bits is not None and (invalid := np.flatnonzero(signal.invalidation_bits)).size:
            raise FormatError(
                path,
                f"{invalid.size} samples of {signal.name} are marked as invalid, the first is sample {invalid[0]}; "
                "valid ones were expected, so cut the measurement or leave the channel out.",
            )
    time = np.asarray(found[0].timestamps, dtype=np.float64)
    for signal in found[1:]:
        if signal.timestamps.shape != time.shape or not np.array_equal(signal.timestamps, time):
            raise FormatError(
                path,
                f"{found[0].name} has {time.size} and {signal.name} {signal.timestamps.size} samples, or at other "
                "times; channels of one and the same time were expected, so export one group.",
            )
    samples = np.array([signal.samples for signal in found], dtype=np.float64)
    names, units = [signal.name for signal in found], [signal.unit or "" for signal in found]
    attributes = left_out([signal.name for signal in signals if not _is_numbers(signal)])
    return signals_read(path, names, units, samples, time=time, attributes=attributes)


def _is_numbers(signal: Any) -> bool:
    return signal.samples.ndim == 1 and signal.samples.dtype.kind in "iuf"


def _members(measurement: Any, number: int) -> list[tuple[int, int]]:
    """Return the indices (group, channel) of a virtual group's channels, without its time."""
    included = measurement.included_channels(number)[number]
    return [(group, index) for group, indices in included.items() for index in indices]


def write_mdf4(signals: Signals, path: Path) -> Written:
    """Write an MDF 4.10 measurement of float64, one group."""
    asammdf = require_library("asammdf", extra="mdf")
    time = signals.time
    # asammdf saves under this suffix only.
    saved = path.with_suffix(".mf4")
    try:
        with asammdf.MDF(version="4.10") as measurement:
            measurement.append(
                [
                    asammdf.Signal(samples=row, timestamps=time, name=channel.name, unit=channel.unit)
                    for channel, row in zip(signals.channels, signals.samples, strict=True)
                ],
                comment="duralab",
                common_timebase=True,
            )
            measurement.save(saved, overwrite=True)
        saved.replace(path)
    finally:
        if saved != path:
            saved.unlink(missing_ok=True)
    notes = ("MDF 4 keeps no attributes.",) if signals.attributes else ()
    return Written(path, "mdf4", signals.samples.shape[1], 0, (0.0,) * len(signals.channels), notes)
