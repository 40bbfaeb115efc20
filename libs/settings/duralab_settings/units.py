"""Units as written by measurement systems, converted by pint."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import pint

_WRITTEN_SO: Final = {
    # As written by measurement systems; some of these names are other units in pint (g is the gram, Nm is a unit of
    # yarn, Ns is several newtons).
    "g": "standard_gravity",
    "G": "standard_gravity",
    "g's": "standard_gravity",
    "G's": "standard_gravity",
    "mg": "millistandard_gravity",
    "mG": "millistandard_gravity",
    "ug": "microstandard_gravity",
    "µg": "microstandard_gravity",
    "°": "degree",
    "deg": "degree",
    "Deg": "degree",
    "DEG": "degree",
    "°/s": "degree/second",
    "deg/s": "degree/second",
    "°C": "degC",
    "RPM": "rpm",
    "%": "percent",
    "µε": "microstrain",
    "µE": "microstrain",
    "uE": "microstrain",
    "ustrain": "microstrain",
    "KN": "kilonewton",
    "Nm": "newton*meter",
    "N-m": "newton*meter",
    "mNm": "millinewton*meter",
    "cNm": "centinewton*meter",
    "daNm": "decanewton*meter",
    "kNm": "kilonewton*meter",
    "kN-m": "kilonewton*meter",
    "KNm": "kilonewton*meter",
    "MNm": "meganewton*meter",
    "Nmm": "newton*millimeter",
    "N-mm": "newton*millimeter",
    "Ns": "newton*second",
    "kNs": "kilonewton*second",
    "Nms": "newton*meter*second",
    "Pas": "pascal*second",
    "ft-lb": "foot*force_pound",
    "ft-lbf": "foot*force_pound",
    "lb-ft": "foot*force_pound",
    "lbf-ft": "foot*force_pound",
    "in-lb": "inch*force_pound",
    "in-lbf": "inch*force_pound",
    "lbs": "pound",
    "1": "dimensionless",
    "-": "dimensionless",
}

_RARE_PREFIXES: Final = frozenset(
    ("peta", "exa", "zetta", "yotta", "ronna", "quetta", "femto", "atto", "zepto", "yocto", "ronto", "quecto")
)
"""Prefixes of no channel of a rig: pint reads PA as petaampere."""

_RARELY_PREFIXED: Final = frozenset(("year", "day", "hour", "minute", "molar", "number_meter", "gram"))
"""Units that have no prefix in a measurement file, except the kilogram: pint reads pa as picoyear, MM as megamolar."""

_OFTEN_MEANT: Final = {
    unit.casefold(): unit
    for unit in ("N", "kN", "m", "mm", "Pa", "kPa", "MPa", "bar", "psi", "g", "V", "s", "kg", "Hz", "kHz", "rad")
}
"""Units that are suggested for the same letters in another case."""

_LONGEST_SYMBOL: Final = 2
"""Largest number of letters of a symbol that has no plural: As is not several amperes, and lbfs are several lbf."""

_FACTOR: Final = re.compile(r"[^\s*/^().·⋅]+")
_POWER: Final = re.compile("([A-Za-zµ°]+)([23])")
_SUPERSCRIPTS: Final = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"


class UnitError(ValueError):
    """Unit that is unknown, or does not convert to another; one sentence."""


@cache
def _registry() -> pint.UnitRegistry:
    from pint import UnitRegistry

    registry = UnitRegistry(autoconvert_offset_to_baseunit=False)
    registry.define("microstrain = 1e-6 = µstrain")
    return registry


def _unit(text: str, channel: str) -> pint.Unit:
    if not text.strip():
        raise UnitError(f"{channel} names no unit, so that it cannot be converted; '1' stands for none.")
    try:
        return _registry().parse_units(_spelled_out(text))
    # The expression parser of pint can raise any exception: tokens, types, assertions.
    except Exception as error:
        meant = _OFTEN_MEANT.get(text.strip().casefold())
        guess = f" (did you mean {meant}?)" if meant is not None and meant != text.strip() else ""
        raise UnitError(
            f"The unit {text!r} of {channel} is not known{guess}; units like N, kN, mm, m/s^2, g, deg or bar are."
        ) from error


def _spelled_out(text: str) -> str:
    """Return a unit as pint spells it; a product or quotient, such as mV/g, is read factor by factor."""
    # Two letters look like the prefix micro: the micro sign and the Greek mu.
    text = text.strip().replace("μ", "µ")
    return _WRITTEN_SO.get(text) or _FACTOR.sub(lambda found: _spelled_out_factor(found[0]), text)


def _spelled_out_factor(factor: str) -> str:
    if factor in ("1", "-"):
        # A numerator, or an exponent.
        return factor
    name, power = factor.rstrip(_SUPERSCRIPTS), factor[len(factor.rstrip(_SUPERSCRIPTS)) :]
    if (written := _WRITTEN_SO.get(name)) is not None:
        return f"({written}){power}"
    if not power and (found := _POWER.fullmatch(name)) is not None and not _registry().parse_unit_name(name):
        return f"{_spelled_out_factor(found[1])}**{found[2]}"
    _check_likely(name)
    return factor


def _check_likely(name: str) -> None:
    """Refuse a symbol that pint can read, but that no measurement file means so."""
    for prefix, unit, plural in _registry().parse_unit_name(name)[:1]:
        if name.startswith(prefix) and prefix:
            # The prefix is a word, such as in milligram.
            continue
        rare = prefix in _RARE_PREFIXES or (unit in _RARELY_PREFIXED and prefix and (prefix, unit) != ("kilo", "gram"))
        if rare or (plural and len(_registry().get_symbol(unit)) <= _LONGEST_SYMBOL and unit not in name):
            raise ValueError(name)


def _base(unit: pint.Unit) -> str:
    return str(_registry().get_base_units(unit)[1]) or "1"


def base_unit(text: str, channel: str) -> str:
    """Return a unit's base units: unlike its dimension, they distinguish an angle from a strain, and rpm from Hz.

    Parameters
    ----------
    text : str
        Any unit of pint; "g" is the standard gravity, not the gram, and "mg" its thousandth.
    channel : str
        Channel with this unit, for the sentence of an error.

    Returns
    -------
    str
        Base units, the same for all units that convert to one another; "1" for none.

    Raises
    ------
    UnitError
        If the unit is unknown.
    """
    return _base(_unit(text, channel))


def unit_conversion(given: str, wanted: str, channel: str, *, times: str = "1") -> tuple[float, float]:
    """Return factor and offset from one unit to another.

    Parameters
    ----------
    given, wanted : str
        Any units of pint.
    channel : str
        Channel with these units, for the sentence of an error.
    times : str
        Unit by which `given` is multiplied, such as that of a weight.

    Returns
    -------
    tuple of float
        `wanted` value = factor * `given` value + offset.

    Raises
    ------
    UnitError
        If a unit is unknown, or they are of different dimensions.
    """
    source, goal = _unit(given, channel), _unit(wanted, channel)
    weight = _unit(times, f"the weight of {channel}")
    if times.strip() not in ("1", "-"):
        source, given = weight * source, f"{times}*{given}"
    if _base(source) != _base(goal):
        raise UnitError(
            f"{channel} is in {given!r}, which cannot be converted to {wanted!r}: one is measured in {_base(source)}, "
            f"the other in {_base(goal)}; correct the unit."
        )
    zero, one = (float(_registry().Quantity(value, source).to(goal).magnitude) for value in (0.0, 1.0))
    return (one - zero, zero) if zero else (one, 0.0)
