"""Mount the sensors of a specimen's responses on its tree: from names and design positions to what they look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig_sim.elements import Rubber, Strut
from rig_sim.model.measurement import Accelerometer, BushingForce, Sensor, SpindleForce, SpindleMoment, StrutTravel
from rig_sim.multibody import Bushing, Element, JointKind, Motion, MultibodyTree, Pose
from rig_sim.specimen import (
    AccelerationChannel,
    BushingChannel,
    Quantity,
    ResponseChannel,
    SpindleChannel,
    StrutChannel,
)


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
    body_a, frame_a = tree.frame(channel.frame_a)
    body_c, frame_c = tree.frame(channel.frame_c)
    found = [
        bushing
        for bushing in tree.bushings
        if (bushing.body_a, bushing.body_c) == (body_a, body_c)
        and _same(bushing.frame_a, frame_a)
        and _same(bushing.frame_c, frame_c)
    ]
    if len(found) != 1:
        raise ValueError(
            f"response {channel.name!r} is on the bushing from {channel.frame_a!r} to {channel.frame_c!r}; the SDF has "
            f"{len(found)} of them, and must have one."
        )
    rubber = tuple(element for element in elements if isinstance(element, Rubber) and _is_beside(element, found[0]))
    return BushingForce(channel.name, found[0], rubber, "xyz".index(channel.axis))


def _is_beside(rubber: Rubber, bushing: Bushing) -> bool:
    return (
        (rubber.body_a, rubber.body_c) == (bushing.body_a, bushing.body_c)
        and _same(rubber.frame_a, bushing.frame_a)
        and np.array_equal(rubber.point_c, bushing.frame_c.origin)
    )


def _same(a: Pose, b: Pose) -> bool:
    return np.array_equal(a.origin, b.origin) and np.array_equal(a.rotation, b.rotation)
