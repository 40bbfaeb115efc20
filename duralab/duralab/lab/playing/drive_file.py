"""A drive from a file, in the units and at the sample rate of the rig that shall play it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from duralab.data import LARGEST_RATE_ERROR, Rig, Signals
from duralab.errors import InputError
from duralab.formats import convert_units, named_units, read_signals


def read_drive_file(path: Path, rig: Rig, *, units: Sequence[str] = ()) -> Signals:
    """Read a drive from a file of any format that `duralab.formats` knows.

    `path`: The file; its channels have the names of the rig's drives, in any order. `rig`: That shall play it. `units`:
    What the values are in where the file does not say it: one unit for all such channels, or "<channel>=<unit>", which
    goes before what the file says of that channel.
    Returns: All drives of the rig in its order and units, at its sample rate.
    Raises `InputError`: The file cannot be read, a drive is missing or unknown, or a unit or the sample rate is missing
    or does not fit.
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
    told = _with_units(given, units, path=path, rig=rig)
    converted = convert_units(told, {channel.name: channel.unit for channel in rig.drives})
    return Signals(rig.drives, rig.sample_rate, converted.samples)


def _with_units(given: Signals, units: Sequence[str], *, path: Path, rig: Rig) -> Signals:
    """Return the channels with the units that a person states, none without one: a guess would move the rig wrongly."""
    named, plain = named_units(units)
    strangers = [name for name in named if name not in given.names]
    if strangers:
        raise InputError(
            f"--unit names {', '.join(strangers)}; the drives of rig {rig.name!r} are {', '.join(given.names)}.",
            field="unit",
        )
    if len(plain) > 1:
        raise InputError(f"--unit gives {' and '.join(plain)} for all; give one, or CHANNEL=UNIT.", field="unit")
    silent = [channel.name for channel in given.channels if not (channel.unit.strip() or channel.name in named)]
    if plain and not silent:
        raise InputError(
            f"--unit is {plain[0]}, but {path} tells the unit of every drive; leave it out, or give CHANNEL=UNIT where "
            "the file is wrong.",
            field="unit",
        )
    if silent and not plain:
        allowed = ", ".join(dict.fromkeys(channel.unit for channel in rig.drives if channel.name in silent))
        raise InputError(
            f"{path} names no unit for {', '.join(silent)}, so that rig {rig.name!r} cannot play it; a unit that "
            f"converts to {allowed} is allowed, so say what the values are in: --unit UNIT, or --unit CHANNEL=UNIT.",
            field="drive.unit",
        )
    named |= dict.fromkeys(silent, *plain)
    channels = (replace(channel, unit=named.get(channel.name, channel.unit)) for channel in given.channels)
    return replace(given, channels=tuple(channels))
