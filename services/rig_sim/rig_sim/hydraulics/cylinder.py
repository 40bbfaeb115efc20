"""A cylinder: compressible oil on both sides, leakage across the piston, seal friction, end cushions."""

from __future__ import annotations

from typing import Any

from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import exp, maximum, tanh
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class Cushion:
    """Cushion of the piston over the last `length` of its half stroke: a spring and a damper that do not pull."""

    #: Length in m; the contact begins at this distance from the metal end.
    length: Positive
    #: Stiffness in N/m and damping in N*s/m.
    stiffness: Positive
    damping: NotNegative


@parameters(config=STRICT)
class Cylinder:
    """Parameters of a cylinder."""

    #: Piston area on side A, in m^2.
    area: Positive
    #: Half of the stroke, in m; the piston's joint is at zero in the middle.
    half_stroke: Positive
    #: Oil outside the stroke on each side (ports, manifold), in m^3.
    dead_volume: NotNegative
    #: Effective bulk modulus of oil with some air, in Pa.
    bulk_modulus: Positive
    #: Leakage across the piston, in m^3/(s Pa).
    leakage: NotNegative
    #: Coulomb friction of the seals, in N, and the speed at which friction is nearly full, in m/s.
    friction: NotNegative
    friction_speed: Positive
    #: Piston area on side B, in m^2; 0 if it equals that of side A (a double rod).
    rod_side_area: NotNegative = 0.0
    #: Addition of stiction to the Coulomb friction, in N, and the speed over which it fades, in m/s (Stribeck).
    stiction: NotNegative = 0.0
    stribeck_speed: Positive = 0.05
    #: Viscous friction, in N*s/m.
    viscous_friction: NotNegative = 0.0
    cushion: Cushion | None = None

    def __post_init__(self) -> None:
        if self.stiction > 0.0 and not self.stribeck_speed > 2.0 * self.friction_speed:
            raise ValueError(
                f"stribeck_speed is {self.stribeck_speed:g} m/s; it must be above twice the friction_speed, "
                f"{self.friction_speed:g} m/s, else stiction fades before it is there"
            )
        if self.cushion is not None and not self.cushion.length < self.half_stroke:
            raise ValueError(
                f"the cushion is {self.cushion.length:g} m long; it must be shorter than half_stroke, "
                f"{self.half_stroke:g} m"
            )

    @property
    def areas(self) -> tuple[float, float]:
        """Piston areas on sides A and B, in m^2."""
        return self.area, self.rod_side_area or self.area

    @property
    def area_ratio(self) -> float:
        """Area on side B over that on side A; 1 for a double rod."""
        return self.areas[1] / self.area


def pressure_rates(
    cylinder: Cylinder, position: Any, speed: Any, pressures: tuple[Any, Any], flows: tuple[Any, Any]
) -> tuple[Any, Any]:
    """Return the rates of the chamber pressures, in Pa/s."""
    a, b = pressures
    area_a, area_b = cylinder.areas
    leak = cylinder.leakage * (a - b)
    volume_a = cylinder.dead_volume + area_a * (cylinder.half_stroke + position)
    volume_b = cylinder.dead_volume + area_b * (cylinder.half_stroke - position)
    rate_a = cylinder.bulk_modulus * (flows[0] - area_a * speed - leak) / volume_a
    rate_b = cylinder.bulk_modulus * (area_b * speed + leak - flows[1]) / volume_b
    return rate_a, rate_b


def load_pressure(cylinder: Cylinder, a: Any, b: Any) -> Any:
    """Return the force of both chambers over the area of side A, in the unit of the pressures."""
    ratio = cylinder.area_ratio
    return a - b if ratio == 1.0 else a - b * ratio


def seal_friction(cylinder: Cylinder, speed: Any) -> Any:
    """Return magnitude and sense of friction in N, along the motion: subtract it from the force on the piston.

    Stribeck's curve, ``tanh(v / v_f) (F_c + F_s exp(-(v / v_s)^2)) + c v``: smooth, so a stuck piston creeps at a few
    per cent of `friction_speed`.
    """
    level = cylinder.friction
    if cylinder.stiction > 0.0:
        share = speed * (1.0 / cylinder.stribeck_speed)
        level = level + cylinder.stiction * exp(-(share * share))
    force = level * tanh(speed * (1.0 / cylinder.friction_speed))
    return force + cylinder.viscous_friction * speed if cylinder.viscous_friction > 0.0 else force


def cushion_force(cylinder: Cylinder, position: Any, speed: Any) -> Any:
    """Return the force of the end cushions on the piston in N; zero without cushions.

    ``max(k d + c (d / l) d', 0)`` of the depth d into a cushion of length l: the damper grips gradually, so that
    contact begins without a jump, and a retracting piston is never held.
    """
    cushion = cylinder.cushion
    if cushion is None:
        return 0.0
    free = cylinder.half_stroke - cushion.length
    above, below = maximum(position - free, 0.0), maximum(-free - position, 0.0)
    grip = cushion.damping / cushion.length
    down = maximum(above * (cushion.stiffness + grip * speed), 0.0)
    up = maximum(below * (cushion.stiffness - grip * speed), 0.0)
    return up - down


def piston_force(cylinder: Cylinder, position: Any, speed: Any, pressures: tuple[Any, Any]) -> Any:
    """Return the force on the piston in N: oil minus seal friction, plus the cushions."""
    force = cylinder.area * load_pressure(cylinder, *pressures) - seal_friction(cylinder, speed)
    return force if cylinder.cushion is None else force + cushion_force(cylinder, position, speed)
