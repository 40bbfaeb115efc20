"""Effects of elements on the rig at one instant, and the force elements of SDF: springs, Drake's bushing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rig_sim.compile import inverse_sqrt
from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import (
    Array,
    Spatial,
    cross,
    dot,
    quaternion_from_rotation,
    roll_pitch_yaw,
    roll_pitch_yaw_rates,
    rotation_from_quaternion,
    wrench_at,
)
from rig_sim.multibody.tree import Bushing, MultibodyTree, SpringDamper


@dataclass
class Line:
    """A hydraulic supply for the actuators: pressures in Pa, and the flow drawn so far, in m^3/s."""

    pressure: Any
    back: Any
    drawn: Any = 0.0


@dataclass
class Effect:
    """Sum of the effects of all elements, each of which adds to it.

    Wrenches are on each body about the world's origin, joint forces on each freedom, in N*m and N. Monitored are named
    values in addition to the responses, e.g. a valve's opening. Hydraulic supplies are offered before any element is
    applied; elements add the flow that they draw.
    """

    wrenches: list[Spatial]
    joint_forces: list[Any]
    monitored: dict[str, Any] = field(default_factory=dict)
    lines: dict[str, Line] = field(default_factory=dict)

    def between(self, body_a: int, body_b: int, wrench: Spatial) -> None:
        """Apply a wrench to body b and its reaction to body a."""
        self.wrenches[body_b] = self.wrenches[body_b] + wrench
        self.wrenches[body_a] = self.wrenches[body_a] - wrench


@dataclass(frozen=True)
class Input:
    """One input of an element: its drive channel and that channel's unit."""

    name: str
    unit: str


class Element(Protocol):
    """A force element or actuator with its own states."""

    @property
    def name(self) -> str:
        """Name, unique in the rig."""
        ...

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Own states at design position and rest."""
        ...

    @property
    def settles(self) -> bool:
        """Whether the own states have one value at rest; friction and a standing tyre keep any."""
        ...

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Drives of this element, in the order of the values of `apply`."""
        ...

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Add this element's wrenches and forces to `effect`, given its inputs' values; return its states' rates."""
        ...


class ForceElement:
    """Common part of most elements: no own state, or one that may keep any value at rest, and no drive."""

    settles = False
    initial_state: tuple[float, ...] = ()
    inputs: tuple[Input, ...] = ()


@runtime_checkable
class Offering(Protocol):
    """An element that supplies others: it offers before any is applied, and is applied after its users."""

    def offer(self, state: Array, effect: Effect) -> None:
        """Add the quantities that depend only on this element's own states to `effect`."""
        ...


def stretch(motion: Motion, body_a: int, point_a: np.ndarray, body_b: int, point_b: np.ndarray) -> tuple[Array, ...]:
    """Return the relative position and motion of two points."""
    a, velocity_a = motion.point(body_a, point_a)
    b, velocity_b = motion.point(body_b, point_b)
    along = b - a
    square = dot(along, along)
    inverse = inverse_sqrt(square)
    direction = along * inverse
    return a, b, direction, square * inverse, dot(direction, velocity_b - velocity_a)


def add_linear_elements(tree: MultibodyTree, motion: Motion, wrenches: list[Spatial]) -> None:
    """Add the wrenches of all springs and bushings of the SDF to the bodies' wrenches (about the world's origin)."""
    for spring in tree.springs:
        wrench = spring_wrench(spring, motion)
        wrenches[spring.body_a] = wrenches[spring.body_a] + wrench
        wrenches[spring.body_b] = wrenches[spring.body_b] - wrench
    for bushing in tree.bushings:
        wrench = bushing_wrench(bushing, motion)
        wrenches[bushing.body_c] = wrenches[bushing.body_c] + wrench
        wrenches[bushing.body_a] = wrenches[bushing.body_a] - wrench


def spring_pull(spring: SpringDamper, motion: Motion, *, stiffness: Any = 1.0, damping: Any = 1.0) -> Any:
    """Return the force in N that draws a spring's ends together; `stiffness` and `damping` are shares."""
    *_, length, rate = stretch(motion, spring.body_a, spring.point_a, spring.body_b, spring.point_b)
    return (length - spring.free_length) * spring.stiffness * stiffness + rate * spring.damping * damping


def spring_wrench(spring: SpringDamper, motion: Motion, *, stiffness: Any = 1.0, damping: Any = 1.0) -> Spatial:
    """Return the wrench of a spring on its body A, about the world's origin; body B gets the opposite."""
    a, _, direction, *_ = stretch(motion, spring.body_a, spring.point_a, spring.body_b, spring.point_b)
    return wrench_at(a, direction * spring_pull(spring, motion, stiffness=stiffness, damping=damping))


def bushing_wrench(bushing: Bushing, motion: Motion, *, stiffness: Any = 1.0, damping: Any = 1.0) -> Spatial:
    """Return the wrench of a bushing on its body C, about the world's origin; body A gets the opposite.

    `stiffness` and `damping` are shares of its constants.

    Drake's law: the force in the frame half-way (by angle) between A and C, the moment by roll, pitch, yaw. An
    anisotropic bushing in frame A instead gave errors of tens of per cent in the spindle force.
    """
    frame_a = motion.poses[bushing.body_a] @ bushing.frame_a
    frame_c = motion.poses[bushing.body_c] @ bushing.frame_c
    turn = frame_a.rotation.T @ frame_c.rotation
    spin = frame_a.rotation.T @ (motion.velocities[bushing.body_c].angular - motion.velocities[bushing.body_a].angular)

    quaternion = quaternion_from_rotation(turn)
    halfway = rotation_from_quaternion(np.array([1.0 + quaternion[0], *quaternion[1:]]))
    offset = frame_a.rotation.T @ (frame_c.origin - frame_a.origin)
    between = motion.velocities[bushing.body_c].at(frame_c.origin) - motion.velocities[bushing.body_a].at(
        frame_a.origin
    )
    # Velocity of Co in A; then the rate of the offset's components in the half-way frame.
    spin_a = frame_a.rotation.T @ motion.velocities[bushing.body_a].angular
    rate = frame_a.rotation.T @ between - cross(spin_a, offset)
    displacement = halfway.T @ offset
    displacement_rate = halfway.T @ (rate - cross(spin * 0.5, offset))
    force_b = -(
        bushing.force_stiffness * displacement * stiffness + bushing.force_damping * displacement_rate * damping
    )

    force = frame_a.rotation @ (halfway @ force_b)
    total = wrench_at((frame_a.origin + frame_c.origin) * 0.5, force)
    if np.any(bushing.torque_stiffness) or np.any(bushing.torque_damping):
        angles = roll_pitch_yaw(turn)
        to_rates = roll_pitch_yaw_rates(angles)
        gimbal = -(bushing.torque_stiffness * angles * stiffness + bushing.torque_damping * (to_rates @ spin) * damping)
        moment = frame_a.rotation @ (to_rates.T @ gimbal)
        total = Spatial(total.angular + moment, total.linear)
    return total
