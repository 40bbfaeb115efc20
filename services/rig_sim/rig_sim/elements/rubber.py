"""Rubber in parallel with a linear bushing: it stiffens with travel and sticks before it slips.

The element acts along one axis of a frame, in parallel with the linear bushing of the SDF. Friction follows Bouc and
Wen (Wen, *Method for random vibration of hysteretic systems*, 1976) with exponent 1: at small travel it is an extra
spring, at large travel a constant force against the motion. A rig identified at small amplitude is therefore stiffer
than the one that plays the road.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import absolute
from rig_sim.multibody import Array, Effect, ForceElement, Input, Motion, Pose, cross, dot, wrench_at
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class RubberLaw:
    """Parameters of rubber along one axis."""

    #: Growth of the restoring force with the cube of travel, in N/m^3.
    progression: NotNegative
    #: Largest friction force, in N.
    friction: NotNegative
    #: Travel over which friction builds up, in m.
    slip_travel: Positive


def friction_rate(law: RubberLaw, level: Any, speed: Any) -> Any:
    """Return the rate, 1/s, of the friction level (-1 to 1) at a speed [m/s]."""
    return (speed - absolute(speed) * level) * (1.0 / law.slip_travel)


@dataclass(frozen=True)
class Rubber(ForceElement):
    """Rubber between frame A on one body and the origin (m) of frame C on another, along a unit vector in frame A.

    If the bushing beside it wears, its input is the lost share of stiffness, also of progression and friction.
    """

    name: str
    body_a: int
    frame_a: Pose
    body_c: int
    point_c: np.ndarray
    axis: np.ndarray
    law: RubberLaw
    inputs: tuple[Input, ...] = ()

    initial_state = (0.0,)

    def pull(self, motion: Motion, state: Array, *, lost: Any = 0.0) -> Array:
        """Return the force on frame C, (3,) in the world's axes, in N, reduced by the lost share."""
        axis, travel, _ = self._travel(motion)
        force = self.law.progression * travel * travel * travel + self.law.friction * state[0]
        return axis * -(force * (1.0 - lost))

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Apply the force on frame C along the axis, and its reaction."""
        point, _ = motion.point(self.body_c, self.point_c)
        effect.between(self.body_a, self.body_c, wrench_at(point, self.pull(motion, state, lost=sum(values))))
        return [friction_rate(self.law, state[0], self._travel(motion)[2])]

    def _travel(self, motion: Motion) -> tuple[Array, Any, Any]:
        """Return the axis (3,) in the world, and travel [m] and speed [m/s] of frame C along it."""
        pose_a = motion.poses[self.body_a] @ self.frame_a
        axis = pose_a.rotation @ self.axis
        point, velocity = motion.point(self.body_c, self.point_c)
        offset = point - pose_a.origin
        spin = motion.velocities[self.body_a]
        speed = dot(axis, velocity - spin.at(pose_a.origin) - cross(spin.angular, offset))
        return axis, dot(axis, offset), speed
