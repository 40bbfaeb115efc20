"""A double-rod cylinder: compressible oil on both sides, leakage across the piston, seal friction."""

from __future__ import annotations

from typing import Any

from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile.numeric import tanh
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class Cylinder:
    """Parameters of an equal-area cylinder."""

    #: Piston area, in m^2.
    area: Positive
    #: Half of the stroke, in m; the piston's joint is at zero in the middle.
    half_stroke: Positive
    #: Oil outside the stroke on each side (ports, manifold), in m^3.
    dead_volume: NotNegative
    #: Effective bulk modulus of oil with some air, in Pa.
    bulk_modulus: Positive
    #: Leakage across the piston, in m^3/(s Pa).
    leakage: NotNegative
    #: Seal friction, in N, and the speed at which it is nearly full, in m/s.
    friction: NotNegative
    friction_speed: Positive


def pressure_rates(
    cylinder: Cylinder, position: Any, speed: Any, pressures: tuple[Any, Any], flows: tuple[Any, Any]
) -> tuple[Any, Any]:
    """Return the rates of the chamber pressures, in Pa/s.

    Parameters
    ----------
    position, speed : of the piston from mid stroke, in m and m/s; positive makes chamber A larger
    pressures : of chambers A and B, in Pa
    flows : into A and out of B through the valve, in m^3/s

    Returns
    -------
    tuple
        ``beta / V (net flow - dV/dt)`` for A and B (Merritt, chapter 3).
    """
    a, b = pressures
    leak = cylinder.leakage * (a - b)
    swept = cylinder.area * speed
    volume_a = cylinder.dead_volume + cylinder.area * (cylinder.half_stroke + position)
    volume_b = cylinder.dead_volume + cylinder.area * (cylinder.half_stroke - position)
    rate_a = cylinder.bulk_modulus * (flows[0] - swept - leak) / volume_a
    rate_b = cylinder.bulk_modulus * (swept + leak - flows[1]) / volume_b
    return rate_a, rate_b


def piston_force(cylinder: Cylinder, speed: Any, pressures: tuple[Any, Any]) -> Any:
    """Return the force on the piston in N, seal friction included."""
    return cylinder.area * (pressures[0] - pressures[1]) - cylinder.friction * tanh(
        speed * (1.0 / cylinder.friction_speed)
    )
