"""Anti-roll bar: a torsion spring across the body with a lever at each end, joined to the suspension by drop links.

Bar, levers and links have no mass, and the links are rigid: the position of a link's foot determines the angle of its
lever, in closed form. The bar resists the difference of the two angles, so it has no effect while both wheels move
equally. A link carries force only along itself; the foot gets `-moment x d(angle)/d(foot)`, by the principle of
virtual work, so that the forces on the feet balance the bar for any geometry. The body takes the opposite forces in
the bar's bearings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import atan2, cos, sin, sqrt
from rig_sim.multibody import Array, Effect, ForceElement, Motion, dot, wrench_at
from rig_sim.parameters import STRICT, NotNegative, Positive

#: Smallest sine of the angle between a link and its lever, so that they cannot fold over.
SMALLEST_SINE = 0.5


@parameters(config=STRICT)
class AntiRollBarLaw:
    """Parameters of an anti-roll bar."""

    #: Moment per difference of the levers' angles, in N*m/rad, and per difference of their rates, in N*m*s/rad.
    stiffness: Positive
    damping: NotNegative


@dataclass(frozen=True)
class Lever:
    """One end of the bar: its lever turns about the bar's axis on the body, its link ends on another body.

    Raises `ValueError`: Lever or link has no length, or the link is nearly in line with its lever.
    """

    #: Pivot of the lever and its end, in the bar's body's frame, in m; the end in the plane of the lever.
    pivot: np.ndarray
    end: np.ndarray
    #: Unit vector of the bar's axis in the bar's body's frame.
    axis: np.ndarray
    link_body: int
    #: Foot of the link in the link body's frame, in m.
    foot: np.ndarray
    link_length: float
    #: Sign of the two possible positions of the link: +1 or -1.
    branch: float

    @staticmethod
    def at_design(
        *,
        pivot: np.ndarray,
        end: np.ndarray,
        axis: np.ndarray,
        foot: np.ndarray,
        link_body: int,
        local_foot: np.ndarray,
    ) -> Lever:
        """Return the lever whose link joins `end` to `foot` at design, all three points (3,) in the bar's body."""
        along, link = end - pivot, foot - end
        along = along - axis * float(axis @ along)
        radius, length = float(np.linalg.norm(along)), float(np.linalg.norm(link))
        if radius < 1.0e-3 or length < 1.0e-3:
            raise ValueError(f"its lever is {radius:g} m and its link {length:g} m long; both must be at least 0.001 m")
        way = np.cross(axis, along) / radius
        sine = float(way @ link) / length
        if abs(sine) < SMALLEST_SINE:
            raise ValueError(
                f"its link stands at {math.degrees(math.asin(abs(sine))):.0f} degrees to its lever (seen along the "
                f"lever's motion); {math.degrees(math.asin(SMALLEST_SINE)):.0f} or more keep it from folding over"
            )
        return Lever(pivot, end, axis, link_body, local_foot, length, -math.copysign(1.0, sine))

    def angle_and_gradient(self, foot: Array) -> tuple[Any, Array]:
        """Return the lever's angle from design [rad] and its gradient with the foot's position (3,) [rad/m]."""
        lever = self.end - self.pivot
        aside = self.axis * float(self.axis @ lever)
        along = lever - aside
        across = np.cross(self.axis, along)
        to_foot = foot - (self.pivot + aside)
        # |to_foot|^2 + r^2 - L^2 = 2 (to_foot . along cos a + to_foot . across sin a)
        a, b = dot(to_foot, along), dot(to_foot, across)
        c = 0.5 * (dot(to_foot, to_foot) + (float(along @ along) - self.link_length**2))
        angle = atan2(b, a) + self.branch * atan2(sqrt(a * a + b * b - c * c), c)
        cosine, sine = cos(angle), sin(angle)
        link = along * cosine + across * sine - to_foot
        way = across * cosine - along * sine
        return angle, link * (1.0 / dot(link, way))


@dataclass(frozen=True)
class AntiRollBar(ForceElement):
    """An anti-roll bar on a body, with a left and a right lever."""

    name: str
    body: int
    levers: tuple[Lever, Lever]
    law: AntiRollBarLaw

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Apply the moments that reduce the difference of the levers' angles."""
        pose, spin = motion.poses[self.body], motion.velocities[self.body]
        angles, rates, gradients, feet = [], [], [], []
        for lever in self.levers:
            foot, velocity = motion.point(lever.link_body, lever.foot)
            angle, gradient = lever.angle_and_gradient(pose.rotation.T @ (foot - pose.origin))
            gradient = pose.rotation @ gradient
            angles.append(angle)
            # The gradient turns with the body, so only the foot's motion relative to the body counts.
            rates.append(dot(gradient, velocity - spin.at(foot)))
            gradients.append(gradient)
            feet.append(foot)
        moment = self.law.stiffness * (angles[0] - angles[1]) + self.law.damping * (rates[0] - rates[1])
        for lever, foot, gradient, sign in zip(self.levers, feet, gradients, (-1.0, 1.0), strict=True):
            effect.between(self.body, lever.link_body, wrench_at(foot, gradient * (sign * moment)))
        effect.monitored[f"{self.name}.moment"] = moment
        return []
