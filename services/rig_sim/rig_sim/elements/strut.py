"""A strut between two points: progressive spring with preload, digressive damper, bump and rebound stops, friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import absolute, maximum, select_positive, tanh
from rig_sim.multibody import Array, Effect, ForceElement, Input, Motion, stretch, wrench_at
from rig_sim.parameters import STRICT, Finite, NotNegative, Positive


@parameters(config=STRICT)
class StrutLaw:
    """Parameters of a strut; compression counts from the design length, positive when shorter."""

    #: Force at design length, pushing the ends apart, in N.
    preload: Finite
    #: Spring rate at design length, in N/m.
    stiffness: Positive
    #: Growth of the rate with the square of compression, in N/m^3.
    progression: NotNegative
    #: Damping at small speed, in N*s/m, in compression and in rebound.
    compression_damping: NotNegative
    rebound_damping: NotNegative
    #: Speed at which the damper has lost half of its small-speed rate, in m/s.
    knee_speed: Positive
    #: Compression at which the bump stop begins, in m, and its force per square of its own travel, in N/m^2.
    bump_clearance: Positive
    bump_stiffness: NotNegative
    #: Extension at which the rebound stop begins, in m, and its force per square of its own travel, in N/m^2.
    rebound_clearance: Positive
    rebound_stiffness: NotNegative
    #: Friction force of seals and guides, in N, and the speed at which it is nearly full, in m/s.
    friction: NotNegative
    friction_speed: Positive


def strut_force(law: StrutLaw, compression: Any, speed: Any, *, damping_lost: Any = 0.0) -> Any:
    """Return the force in N that pushes the ends apart at a compression [m] and a compression speed [m/s].

    `damping_lost` is a share; the friction of seals and guides stays.
    """
    spring = law.preload + compression * (law.stiffness + law.progression * compression * compression)
    bump = maximum(compression - law.bump_clearance, 0.0)
    rebound = maximum(-compression - law.rebound_clearance, 0.0)
    stops = law.bump_stiffness * bump * bump - law.rebound_stiffness * rebound * rebound
    rate = select_positive(speed, law.compression_damping, law.rebound_damping)
    damper = rate * speed / (1.0 + absolute(speed) * (1.0 / law.knee_speed)) * (1.0 - damping_lost)
    return spring + stops + damper + law.friction * tanh(speed * (1.0 / law.friction_speed))


@dataclass(frozen=True)
class Strut(ForceElement):
    """A strut between a point on body a and a point on body b, both in their body's frame, in metres.

    If it wears, its input is the lost share of damping.
    """

    name: str
    body_a: int
    point_a: np.ndarray
    body_b: int
    point_b: np.ndarray
    design_length: float
    law: StrutLaw
    inputs: tuple[Input, ...] = ()

    def force(self, motion: Motion, values: Array) -> Any:
        """Return the force in N that pushes the ends apart."""
        *_, length, rate = stretch(motion, self.body_a, self.point_a, self.body_b, self.point_b)
        return strut_force(self.law, self.design_length - length, -rate, damping_lost=sum(values))

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Push the two bodies apart."""
        _, b, direction, *_ = stretch(motion, self.body_a, self.point_a, self.body_b, self.point_b)
        effect.between(self.body_a, self.body_b, wrench_at(b, direction * self.force(motion, values)))
        return []
