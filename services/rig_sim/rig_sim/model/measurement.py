"""Measurements of a rig: forces and moments at a spindle, accelerations, strut travel, forces in bushings.

Each sensor reads the rig at one instant, over generic scalars like the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rig_sim.elements import LinearLoss, Rubber, Strut
from rig_sim.multibody import (
    Accelerations,
    Array,
    Bushing,
    Element,
    JointKind,
    Motion,
    MultibodyTree,
    Pose,
    Spatial,
    bushing_wrench,
    cross,
    inertia_in_world,
    stretch,
)
from rig_sim.specimen import (
    AccelerationChannel,
    Axis,
    BushingChannel,
    Quantity,
    ResponseChannel,
    SpindleChannel,
    StrutChannel,
)


@dataclass(frozen=True)
class Instant:
    """State of the rig at one instant for the sensors."""

    tree: MultibodyTree
    motion: Motion
    #: Sum of the external wrenches on each body about the world's origin, without gravity.
    wrenches: list[Spatial]
    accelerations: Accelerations
    #: Own states of each element and values of the inputs, by name.
    element_states: dict[str, Array]
    inputs: dict[str, Any]


class Sensor(Protocol):
    """A sensor; its name is its response's."""

    @property
    def name(self) -> str:
        """Name of the response."""
        ...

    def read(self, instant: Instant) -> Any:
        """Return the measured value in the response's unit, without noise."""
        ...


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
        # Not as the moment below: the acceleration of the centre of mass takes fewer operations.
        body, pose = instant.tree.bodies[self.wheel], instant.motion.poses[self.wheel]
        centre = pose.rotation @ body.centre + pose.origin
        velocity, proper = instant.motion.velocities[self.wheel], instant.accelerations.proper[self.wheel]
        acceleration = proper.at(centre) + cross(velocity.angular, velocity.at(centre))
        force = instant.wrenches[self.wheel].linear - acceleration * body.mass
        return ((pose.rotation @ self.frame.rotation).T @ force)[self.row]


@dataclass(frozen=True)
class SpindleMoment(SpindleForce):
    """One component of the moment at a wheel-force transducer, about its centre, in the sensor's axes, in N*m."""

    def read(self, instant: Instant) -> Any:
        """Return the moment of the wheel on the spindle: the moment on the wheel minus its inertia."""
        body, pose = instant.tree.bodies[self.wheel], instant.motion.poses[self.wheel]
        velocity, proper = instant.motion.velocities[self.wheel], instant.accelerations.proper[self.wheel]
        inertia = inertia_in_world(body, pose)
        gyration = velocity.force_cross(inertia.momentum(velocity))
        wrench = instant.wrenches[self.wheel] - inertia.momentum(proper) - gyration
        frame = instant.motion.poses[self.wheel] @ self.frame
        return (frame.rotation.T @ (wrench.angular - cross(frame.origin, wrench.linear)))[self.row]


@dataclass(frozen=True)
class Accelerometer:
    """One component of a point's acceleration in the axes of its body, in m/s^2.

    It is the acceleration of the motion, without gravity, as from a piezoelectric sensor, which passes no steady
    value. A tilt of the body adds no share of gravity.
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

    Sum of the bushing of the SDF and all rubber between the same two frames, minus the wear of both, as from a load
    cell in the mount.
    """

    name: str
    bushing: Bushing
    rubber: tuple[Rubber, ...]
    row: int
    loss: LinearLoss | None = None

    def read(self, instant: Instant) -> Any:
        """Return the force on the mount."""
        force = -bushing_wrench(self.bushing, instant.motion).linear
        force = force + self.beside(instant.motion, instant.element_states, instant.inputs)
        axes = instant.motion.poses[self.bushing.body_a].rotation @ self.bushing.frame_a.rotation
        return (axes.T @ force)[self.row]

    def beside(self, motion: Motion, element_states: Mapping[str, Array], inputs: Mapping[str, Any]) -> Any:
        """Return the force of rubber and wear beside the bushing of the SDF on the mount, world's axes, in N."""
        force: Any = np.zeros(3)
        for rubber in self.rubber:
            lost = sum(inputs[item.name] for item in rubber.inputs)
            force = force - rubber.pull(motion, element_states[rubber.name], lost=lost)
        if self.loss is not None:
            stiffness, damping = (inputs[item.name] for item in self.loss.inputs)
            force = force + bushing_wrench(self.bushing, motion, stiffness=stiffness, damping=damping).linear
        return force


def mount_sensor(channel: ResponseChannel, tree: MultibodyTree, design: Motion, elements: Sequence[Element]) -> Sensor:
    """Return the sensor of a response channel."""
    match channel:
        case SpindleChannel():
            return _spindle(channel, tree)
        case AccelerationChannel():
            return _accelerometer(channel, tree, design)
        case StrutChannel():
            return _strut_travel(channel, elements)
        case BushingChannel():
            return _bushing_force(channel, tree, elements)


def _spindle(channel: SpindleChannel, tree: MultibodyTree) -> SpindleForce | SpindleMoment:
    joint = tree.joint(channel.transducer)
    if joint.kind is not JointKind.WELD:
        raise ValueError(
            f"response {channel.name!r} is measured at joint {joint.name!r}, which is {joint.kind.name.lower()}; "
            "a wheel-force transducer is a weld (a fixed joint)."
        )
    carried = [other.name for other in tree.joints if other.parent == joint.child]
    if carried:
        raise ValueError(
            f"response {channel.name!r}: joint {carried[0]!r} hangs on {tree.bodies[joint.child].name!r}; "
            "behind a wheel-force transducer there is one wheel and nothing more."
        )
    kind = SpindleForce if channel.quantity is Quantity.FORCE else SpindleMoment
    return kind(channel.name, joint.child, joint.frame_on_child, "xyz".index(channel.axis))


def _accelerometer(channel: AccelerationChannel, tree: MultibodyTree, design: Motion) -> Accelerometer:
    body = tree.body_index(channel.body)
    if body == 0:
        raise ValueError(f"response {channel.name!r} is on the world, which does not move; put it on a body.")
    pose = design.poses[body]
    local = pose.rotation.T @ (np.array(channel.point) - pose.origin)
    return Accelerometer(channel.name, body, local, "xyz".index(channel.axis))


def _strut_travel(channel: StrutChannel, elements: Sequence[Element]) -> StrutTravel:
    struts = {element.name: element for element in elements if isinstance(element, Strut)}
    strut = struts.get(channel.strut)
    if strut is None:
        raise ValueError(
            f"response {channel.name!r} is on strut {channel.strut!r}; there are {', '.join(struts) or 'none'}."
        )
    return StrutTravel(channel.name, strut.body_a, strut.point_a, strut.body_b, strut.point_b, strut.design_length)


def _bushing_force(channel: BushingChannel, tree: MultibodyTree, elements: Sequence[Element]) -> BushingForce:
    try:
        bushing = find_bushing(tree, channel.frame_a, channel.frame_c)
    except ValueError as error:
        raise ValueError(f"response {channel.name!r}: {error}") from error
    return bushing_force(channel.name, bushing, elements, channel.axis)


def bushing_force(name: str, bushing: Bushing, elements: Sequence[Element], axis: Axis) -> BushingForce:
    """Return the load cell in a bushing's mount; the elements hold its rubber and its wear."""
    rubber = tuple(element for element in elements if isinstance(element, Rubber) and is_beside(element, bushing))
    losses = (element for element in elements if isinstance(element, LinearLoss) and element.part is bushing)
    return BushingForce(name, bushing, rubber, "xyz".index(axis), next(losses, None))


def find_bushing(tree: MultibodyTree, name_a: str, name_c: str) -> Bushing:
    """Return the one bushing between two frames, or raise `ValueError`."""
    body_a, frame_a = tree.frame(name_a)
    body_c, frame_c = tree.frame(name_c)
    found = [
        bushing
        for bushing in tree.bushings
        if (bushing.body_a, bushing.body_c) == (body_a, body_c)
        and _same(bushing.frame_a, frame_a)
        and _same(bushing.frame_c, frame_c)
    ]
    if len(found) != 1:
        raise ValueError(
            f"it is on the bushing from {name_a!r} to {name_c!r}; the SDF has {len(found)} of them, and must have one."
        )
    return found[0]


def is_beside(rubber: Rubber, bushing: Bushing) -> bool:
    """Return whether rubber of the YAML is between the two frames of a bushing."""
    return (
        (rubber.body_a, rubber.body_c) == (bushing.body_a, bushing.body_c)
        and _same(rubber.frame_a, bushing.frame_a)
        and np.array_equal(rubber.point_c, bushing.frame_c.origin)
    )


def _same(a: Pose, b: Pose) -> bool:
    return np.array_equal(a.origin, b.origin) and np.array_equal(a.rotation, b.rotation)
