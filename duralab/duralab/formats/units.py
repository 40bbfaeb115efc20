"""Units of channels, converted by pint, and channels calculated from others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.data import Channel, Signals
from duralab.errors import InputError
from duralab.formats.errors import as_input_error
from duralab_settings import base_unit, unit_conversion

if TYPE_CHECKING:
    from duralab_gateway import CalculatedChannel

SI_UNITS: Final = (
    *("m", "m/s", "m/s^2", "N", "N*m", "Pa", "rad", "rad/s", "rad/s^2"),
    *("s", "Hz", "kg", "V", "A", "K", "1"),
)
"""Units of a lab's contract; channels of other dimensions are refused."""


@as_input_error()
def convert_units(signals: Signals, units: Mapping[str, str] | Iterable[str] = SI_UNITS) -> Signals:
    """Convert channels to other units.

    Parameters
    ----------
    signals : Signals
        Signals in any units of pint; "g" is the standard gravity, 9.80665 m/s², not the gram.
    units : mapping of str to str, or iterable of str
        Wanted unit by channel name, other channels are unchanged; or units, of which each channel gets the one of its
        dimension: ("N", "mm") or, by default, SI.

    Returns
    -------
    Signals
        Signals in those units.

    Raises
    ------
    InputError
        A unit is unknown or has another dimension, none or several of the given units have a channel's dimension, or a
        channel does not exist.
    """
    wanted = dict(units) if isinstance(units, Mapping) else _by_dimension(signals, tuple(units))
    strangers = sorted(set(wanted) - set(signals.names))
    if strangers:
        raise InputError(
            f"There is no channel {', '.join(strangers)}; there are {', '.join(signals.names)}.", field="unit"
        )
    samples = signals.samples.copy()
    channels = list(signals.channels)
    for row, channel in enumerate(signals.channels):
        unit = wanted.get(channel.name, channel.unit)
        if unit != channel.unit:
            factor, offset = unit_conversion(channel.unit, unit, channel.name)
            # An overflow to infinity is refused later, when the signals are written or edited.
            with np.errstate(over="ignore"):
                samples[row] = samples[row] * factor + offset
            channels[row] = replace(
                channel, unit=unit, minimum=channel.minimum * factor + offset,
                maximum=channel.maximum * factor + offset, slew_limit=channel.slew_limit * factor,
                actuator_speed=channel.actuator_speed * factor,
                sensor=None if channel.sensor is None else channel.sensor.scaled(factor, offset),
                calculated=tuple((name, weight * factor) for name, weight in channel.calculated),
            )  # fmt: skip
    return replace(signals, channels=tuple(channels), samples=samples)


def add_calculated(signals: Signals, calculated: Iterable[CalculatedChannel]) -> Signals:
    """Add channels that are calculated from others, such as the sum of two measured forces.

    Parameters
    ----------
    signals : Signals
        Signals in any units of pint.
    calculated : iterable of CalculatedChannel
        Channels to add, from `duralab_gateway`; each is calculated from channels of `signals` only.

    Returns
    -------
    Signals
        Given channels, then the calculated ones in the SI unit of their kind.

    Raises
    ------
    InputError
        A channel does not exist, the name of a calculated one already exists, or a unit cannot be converted.
    """
    from duralab_gateway import weighted_sum
    from duralab_settings import SettingsError

    units = {channel.name: channel.unit for channel in signals.channels}
    channels, rows = list(signals.channels), list(signals.samples)
    for one in calculated:
        if one.name in [channel.name for channel in channels]:
            raise InputError(f"{one.name} is calculated, and exists already; give it another name.", field="calculated")
        try:
            factors = one.factors(units)
        except SettingsError as error:
            raise InputError(str(error), field="calculated") from error
        terms = tuple(factors.items())
        channels.append(Channel(one.name, one.unit, kind=one.kind_number, label=one.label, calculated=terms))
        rows.append(weighted_sum({list(units).index(name): factor for name, factor in terms}, signals.samples))
    return replace(signals, channels=tuple(channels), samples=np.stack(rows))


def named_units(units: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Separate the units of single channels from those of all channels.

    Parameters
    ----------
    units : sequence of str
        Units in the form of the option `--unit`: "<channel>=<unit>" or "<unit>".

    Returns
    -------
    dict of str to str, list of str
        Units by channel name; the other units, in their order.

    Raises
    ------
    InputError
        A channel is given two units.
    """
    named: dict[str, str] = {}
    for channel, unit in (text.split("=", 1) for text in units if "=" in text):
        if channel in named:
            raise InputError(
                f"--unit gives {channel} two units, {named[channel]} and {unit}; give each channel one.", field="unit"
            )
        named[channel] = unit
    return named, [text for text in units if "=" not in text]


def _by_dimension(signals: Signals, units: tuple[str, ...]) -> dict[str, str]:
    goals = [(unit, base_unit(unit, "the units wanted")) for unit in units]
    bases = [base_unit(channel.unit, channel.name) for channel in signals.channels]
    wanted = {}
    for channel, base in zip(signals.channels, bases, strict=True):
        fitting = [unit for unit, goal in goals if goal == base]
        if not fitting:
            raise InputError(
                f"{channel.name} is in {channel.unit!r}, and none of {', '.join(units)} has its dimension; "
                "give one that has.",
                field="unit",
            )
        if len(set(fitting)) > 1:
            several = " or ".join(dict.fromkeys(fitting))
            raise InputError(f"{channel.name} can be in {several}; give one unit of a kind.", field="unit")
        wanted[channel.name] = fitting[0]
    return wanted
