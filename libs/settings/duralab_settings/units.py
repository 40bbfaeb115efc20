"""Units as written by measurement systems, converted by pint."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import pint

_WRITTEN_SO: Final = {
    # As written by measurement systems; some of these names are other units in pint (g is the gram).
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


_FACTOR: Final = re.compile(r"[^\s*/^()]+")


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
    written = _WRITTEN_SO.get(text.strip(), text.strip())
    try:
        return _registry().parse_units(written)
    # The expression parser of pint can raise any exception: tokens, types, assertions.
    except Exception as error:
        raise UnitError(
            f"The unit {text!r} of {channel} is not known; units like N, kN, mm, m/s^2, g, deg or bar are."
        ) from error


def _base(unit: pint.Unit) -> str:
    return str(_registry().get_base_units(unit)[1]) or "1"


def base_unit(text: str, channel: str) -> str:
    """Return a unit's base units: unlike its dimension, they distinguish an angle from a strain, and rpm from Hz.

    Parameters
    ----------
    text : str
        Any unit of pint; "g" is the standard gravity, not the gram.
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
    # A product or quotient, such as mV/g, is read factor by factor.
    written = _FACTOR.sub(lambda found: _WRITTEN_SO.get(found[0], found[0]), text)
    return _base(_unit(written, channel))


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
