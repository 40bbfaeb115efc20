"""Units of channels, converted by pint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Final

from duralab.data import Signals
from duralab.errors import InputError

if TYPE_CHECKING:
    import pint

SI_UNITS: Final = (
    *("m", "m/s", "m/s^2", "N", "N*m", "Pa", "rad", "rad/s", "rad/s^2"),
    *("s", "Hz", "kg", "V", "A", "K", "1"),
)
"""What a lab's contract speaks; channels of other dimensions are refused."""

_WRITTEN_SO: Final = {
    # As measurement systems write them; pint knows other things by some of these names (g is the gram).
    "g": "standard_gravity",
    "G": "standard_gravity",
    "°": "degree",
    "deg": "degree",
    "°/s": "degree/second",
    "deg/s": "degree/second",
    "°C": "degC",
    "%": "percent",
    "µε": "microstrain",
    "uE": "microstrain",
    "ustrain": "microstrain",
    "g's": "standard_gravity",
    "G's": "standard_gravity",
    "Nm": "newton*meter",
    "N-m": "newton*meter",
    "kNm": "kilonewton*meter",
    "Nmm": "newton*millimeter",
    "1": "dimensionless",
    "-": "dimensionless",
}


@cache
def _registry() -> pint.UnitRegistry:
    from pint import UnitRegistry

    registry = UnitRegistry(autoconvert_offset_to_baseunit=False)
    registry.define("microstrain = 1e-6 = µstrain")
    return registry


def _unit(text: str, channel: str) -> pint.Unit:
    if not text.strip():
        raise InputError(f"{channel} names no unit, so that it cannot be converted; '1' stands for none.", field="unit")
    written = _WRITTEN_SO.get(text.strip(), text.strip())
    try:
        return _registry().parse_units(written)
    # Its parser of expressions fails with whatever a text breaks: tokens, types, assertions of its own.
    except Exception as error:
        raise InputError(
            f"The unit {text!r} of {channel} is not known; units like N, kN, mm, m/s^2, g, deg or bar are.",
            field="unit",
        ) from error


def _base(unit: pint.Unit) -> str:
    """Return a unit's base units: unlike its dimension, they tell an angle from a strain, and rpm from Hz."""
    return str(_registry().get_base_units(unit)[1]) or "1"


def convert_units(signals: Signals, units: Mapping[str, str] | Iterable[str] = SI_UNITS) -> Signals:
    """Convert channels to other units.

    Parameters
    ----------
    signals : Signals
        In any units that pint knows; "g" is the standard gravity, 9.80665 m/s², not the gram.
    units : mapping of str to str, or iterable of str
        The unit wanted by the channel's name, others stay as they are; or units, of which each channel takes the one of
        its dimension: ("N", "mm") or, as by default, SI.

    Returns
    -------
    Signals
        In those units, and with their names.

    Raises
    ------
    InputError
        A unit is not known, has another dimension, or none or several of those given have a channel's dimension; a
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
            factor, offset = _conversion(channel.unit, unit, channel.name)
            samples[row] = samples[row] * factor + offset
            channels[row] = replace(
                channel, unit=unit, minimum=channel.minimum * factor + offset,
                maximum=channel.maximum * factor + offset, slew_limit=channel.slew_limit * factor,
            )  # fmt: skip
    return replace(signals, channels=tuple(channels), samples=samples)


def named_units(units: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Tell the units of single channels from those for all.

    Parameters
    ----------
    units : sequence of str
        Each "<channel>=<unit>" or "<unit>", as the option `--unit` takes them.

    Returns
    -------
    dict of str to str, list of str
        The unit by the channel's name; the others, in their order.

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


def _conversion(given: str, wanted: str, channel: str) -> tuple[float, float]:
    """Return factor and offset from one unit to another."""
    source, goal = _unit(given, channel), _unit(wanted, channel)
    if _base(source) != _base(goal):
        raise InputError(
            f"{channel} is in {given!r}, which cannot be converted to {wanted!r}: one is measured in {_base(source)}, "
            f"the other in {_base(goal)}.",
            field="unit",
        )
    zero, one = (float(_registry().Quantity(value, source).to(goal).magnitude) for value in (0.0, 1.0))
    return (one - zero, zero) if zero else (one, 0.0)


def _by_dimension(signals: Signals, units: tuple[str, ...]) -> dict[str, str]:
    goals = [(unit, _unit(unit, "the units wanted")) for unit in units]
    wanted = {}
    for channel in signals.channels:
        base = _base(_unit(channel.unit, channel.name))
        fitting = [unit for unit, goal in goals if _base(goal) == base]
        if not fitting:
            raise InputError(
                f"{channel.name} is in {channel.unit!r}; none of {', '.join(units)} has its dimension.", field="unit"
            )
        if len(set(fitting)) > 1:
            several = " or ".join(dict.fromkeys(fitting))
            raise InputError(f"{channel.name} can be in {several}; give one unit of a kind.", field="unit")
        wanted[channel.name] = fitting[0]
    return wanted
