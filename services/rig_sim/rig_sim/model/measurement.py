"""What a rig measures: forces and moments at a spindle, accelerations, strut travel, forces in bushings.

Each sensor reads the rig at one instant, over generic scalars like the model it looks at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rig_sim.elements import Rubber
from rig_sim.multibody import (
    Accelerations,
    Array,
    Bushing,
    Motion,
    MultibodyTree,
    Pose,
    Spatial,
    bushing_wrench,
    cross,
    inertia_in_world,
    stretch,
)


@dataclass(frozen=True)
class Instant:
    """The rig at one instant, as far as a sensor can feel it."""

    tree: MultibodyTree
    motion: Motion
    #: Sum of the external wrenches on each body about the world's origin, without gravity.
    wrenches: list[Spatial]
    accelerations: Accelerations
    #: Own states of each element, by its name.
    element_states: dict[str, Array]


class Sensor(Protocol):
    """A sensor; its name is its response's."""

    @property
    def name(self) -> str:
        """Name of the response."""
        ...

    def read(self, instant: Instant) -> Any:
        """Return the measured value in the response's unit, without noise."""
        ...


def _spindle_wrench(instant: Instant, wheel: int) -> Spatial:
    """Wrench of the wheel on the knuckle about the world's origin: what the wheel gets, less what moves it."""
    body, pose = instant.tree.bodies[wheel], instant.motion.poses[wheel]
    velocity, proper = instant.motion.velocities[wheel], instant.accelerations.proper[wheel]
    inertia = inertia_in_world(body, pose)
    return instant.wrenches[wheel] - inertia.momentum(proper) - velocity.force_cross(inertia.momentum(velocity))


@dataclass(frozen=True)
class SpindleForce:
    """One component of the force at a wheel-force transducer, in the sensor's axes, in N."""

    name: str
    wheel: int
    #: The weld in the wheel's frame: the sensor's centre and axes.
    frame: Pose
    row: int

    def read(self, instant: Instant) -> Any:
        """Return the force of the wheel on the spindle."""
        # Not from `_spindle_wrench`: the acceleration of the centre of mass takes fewer operations.
        body, pose = instant.tree.bodies[self.wheel], instant.motion.poses[self.wheel]
        centre = pose.rotation @ body.centre + pose.origin
        velocity, proper = instant.motion.velocities[self.wheel], instant.accelerations.proper[self.wheel]
        acceleration = proper.at(centre) + cross(velocity.angular, velocity.at(centre))
        force = instant.wrenches[self.wheel].linear - acceleration * body.mass
        return ((pose.rotation @ self.frame.rotation).T @ force)[self.row]


@dataclass(frozen=True)
class SpindleMoment:
    """One component of the moment at a wheel-force transducer, about its centre, in the sensor's axes, in N*m."""

    name: str
    wheel: int
    frame: Pose
    row: int

    def read(self, instant: Instant) -> Any:
        """Return the moment of the wheel on the spindle."""
        wrench = _spindle_wrench(instant, self.wheel)
        frame = instant.motion.poses[self.wheel] @ self.frame
        return (frame.rotation.T @ (wrench.angular - cross(frame.origin, wrench.linear)))[self.row]


@dataclass(frozen=True)
class Accelerometer:
    """One component of a point's acceleration in the axes of its body, in m/s^2.

    It is the acceleration of the motion, without gravity: what a piezoelectric sensor shows, which passes no steady
    value. A tilt of the body puts no share of gravity into it.
    """

    name: str
    body: int
    point: np.ndarray
    row: int

    def read(self, instant: Instant) -> Any:
        """Return the acceleration."""
        pose, velocity = instant.motion.poses[self.body], instant.motion.velocities[self.body]
        place = pose.rotation @ self.point + pose.origin
        spatial = instant.accelerations.proper[self.body] + Spatial(np.zeros(3), instant.tree.gravity)
        acceleration = spatial.at(place) + cross(velocity.angular, velocity.at(place))
        return (pose.rotation.T @ acceleration)[self.row]


@dataclass(frozen=True)
class StrutTravel:
    """Compression of a strut from its design length, in m, positive when shorter."""

    name: str
    body_a: int
    point_a: np.ndarray
    body_b: int
    point_b: np.ndarray
    design_length: float

    def read(self, instant: Instant) -> Any:
        """Return the compression."""
        return self.design_length - stretch(instant.motion, self.body_a, self.point_a, self.body_b, self.point_b)[3]


@dataclass(frozen=True)
class BushingForce:
    """One component of the force on the mount (frame A) of a bushing, in the axes of frame A, in N.

    Of the bushing of the SDF together with all rubber between the same two frames: what a load cell in the mount shows.
    """

    name: str
    bushing: Bushing
    rubber: tuple[Rubber, ...]
    row: int

    def read(self, instant: Instant) -> Any:
        """Return the force on the mount."""
        force = -bushing_wrench(self.bushing, instant.motion).linear
        for rubber in self.rubber:
            force = force - rubber.pull(instant.motion, instant.element_states[rubber.name])
        axes = instant.motion.poses[self.bushing.body_a].rotation @ self.bushing.frame_a.rotation
        return (axes.T @ force)[self.row]
