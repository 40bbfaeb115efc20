"""A drive from a file, in the units and at the sample rate of the rig that shall play it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from duralab._target import LARGEST_RATE_ERROR
from duralab.errors import InputError
from duralab.formats import convert_units, read_signals
from duralab.rig import Rig
from duralab.signals import Signals


def read_drive_file(path: Path, rig: Rig) -> Signals:
    """Read a drive from a file of any format that `duralab.formats` knows.

    Parameters
    ----------
    path : Path
        The file; its channels have the names of the rig's drives, in any order.
    rig : Rig
        That shall play it.

    Returns
    -------
    Signals
        All drives of the rig in its order and units, at its sample rate.

    Raises
    ------
    InputError
        The file cannot be read, a drive is missing or unknown, or the unit or the sample rate does not fit.
    """
    signals = read_signals(path)
    wanted = {channel.name: channel for channel in rig.drives}
    missing = [name for name in wanted if name not in signals.names]
    others = [name for name in signals.names if name not in wanted]
    if missing or others:
        faults = [f"lacks {', '.join(missing)}"] if missing else []
        faults += [f"has {', '.join(others)} besides"] if others else []
        raise InputError(
            f"{path} {' and '.join(faults)}; the drives of rig {rig.name!r} are {', '.join(wanted)}.",
            field="drive.channels",
        )
    if abs(signals.sample_rate / rig.sample_rate - 1) > LARGEST_RATE_ERROR:
        raise InputError(
            f"{path} is sampled at {signals.sample_rate:g} Hz; rig {rig.name!r} plays {rig.sample_rate:g} Hz only, so "
            f"make a copy with `duralab convert {path} COPY --rate {rig.sample_rate:g}`.",
            field="drive.sample_rate",
        )
    rows = [signals.names.index(name) for name in wanted]
    given = replace(signals, channels=tuple(signals.channels[row] for row in rows), samples=signals.samples[rows])
    units = {
        channel.name: channel.unit for channel in rig.drives if given.channels[given.names.index(channel.name)].unit
    }
    converted = convert_units(given, units) if units else given
    return Signals(rig.drives, rig.sample_rate, converted.samples)
