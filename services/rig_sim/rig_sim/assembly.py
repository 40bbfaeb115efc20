"""Mount a specimen's parts on its tree: from names and design positions to elements with body indices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig_sim.effect import Element, Input
from rig_sim.elements.rubber import Rubber
from rig_sim.elements.strut import Strut
from rig_sim.elements.tyre import Tyre
from rig_sim.hydraulics.actuator import DisplacementActuator
from rig_sim.multibody.kinematics import Motion, move
from rig_sim.multibody.tree import JointKind, MultibodyTree
from rig_sim.specimen import (
    LEFT,
    RIGHT,
    ActuatorPart,
    RubberPart,
    Specimen,
    SpecimenError,
    SpindleChannel,
    StrutPart,
    TyrePart,
)

_MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Transducer:
    """One measured component: the wheel behind the weld, the sensor's axes in the wheel (3, 3), and the row in them."""

    name: str
    wheel: int
    axes: np.ndarray
    row: int


@dataclass(frozen=True)
class Assembly:
    """A tree with everything mounted on it."""

    specimen: Specimen
    tree: MultibodyTree
    elements: tuple[Element, ...]
    transducers: tuple[Transducer, ...]


def assemble(specimen: Specimen, tree: MultibodyTree) -> Assembly:
    """Mount the parts of a specimen.

    Raises
    ------
    SpecimenError
        Where a part names a body, frame, joint or kind that does not exist or does not fit, two parts or channels share
        a name, the parts' inputs are not the drives in their order, or a drive reaches beyond its cylinder.
    """
    design = move(tree, tree.default_positions, np.zeros(tree.velocity_count))
    elements: list[Element] = []
    try:
        elements += [_actuator(part, specimen, tree) for part in specimen.actuators]
        for tyre in specimen.tyres:
            elements += [_tyre(tyre, tree, right=right) for right in _sides(mirrored=tyre.mirrored)]
        for strut in specimen.struts:
            elements += [_strut(strut, tree, design, right=right) for right in _sides(mirrored=strut.mirrored)]
        for rubber in specimen.rubber:
            elements += [_rubber(rubber, tree, right=right) for right in _sides(mirrored=rubber.mirrored)]
        transducers = tuple(_transducer(channel, tree) for channel in specimen.responses)
        _check_names(specimen, elements)
        _check_drives(specimen, elements)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    return Assembly(specimen, tree, tuple(elements), transducers)


def _sides(*, mirrored: bool) -> tuple[bool, ...]:
    return (False, True) if mirrored else (False,)


def _named(name: str, *, right: bool) -> str:
    return RIGHT + name.removeprefix(LEFT) if right and name.startswith(LEFT) else name


def _strut(part: StrutPart, tree: MultibodyTree, design: Motion, *, right: bool) -> Strut:
    mirror = _MIRROR if right else np.ones(3)
    bodies = [tree.body_index(_named(name, right=right)) for name in (part.body_a, part.body_b)]
    points = [np.array(point) * mirror for point in (part.point_a, part.point_b)]
    local = [
        design.poses[body].rotation.T @ (point - design.poses[body].origin)
        for body, point in zip(bodies, points, strict=True)
    ]
    return Strut(
        name=_named(part.name, right=right),
        body_a=bodies[0],
        point_a=local[0],
        body_b=bodies[1],
        point_b=local[1],
        design_length=float(np.linalg.norm(points[1] - points[0])),
        law=part.law,
    )


def _rubber(part: RubberPart, tree: MultibodyTree, *, right: bool) -> Rubber:
    body_a, pose_a = tree.frame(_named(part.frame_a, right=right))
    body_c, pose_c = tree.frame(_named(part.frame_c, right=right))
    if body_a == body_c:
        raise ValueError(
            f"rubber {part.name!r} has both frames on {tree.bodies[body_a].name!r}; it must join two bodies."
        )
    axis = np.array(part.axis) * (_MIRROR if right else 1.0)
    return Rubber(
        name=_named(part.name, right=right),
        body_a=body_a,
        frame_a=pose_a,
        body_c=body_c,
        point_c=pose_c.origin,
        axis=axis / np.linalg.norm(axis),
        law=part.law,
    )


def _tyre(part: TyrePart, tree: MultibodyTree, *, right: bool) -> Tyre:
    inputs = tuple(
        Input(_named(drive, right=right), unit) for drive, unit in zip(part.drives, ("m", "1", "1", "m/s"), strict=True)
    )
    return Tyre(_named(part.name, right=right), tree.body_index(_named(part.wheel, right=right)), part.law, inputs)


def _actuator(part: ActuatorPart, specimen: Specimen, tree: MultibodyTree) -> DisplacementActuator:
    kind = specimen.actuator_kinds.get(part.kind)
    if kind is None:
        raise ValueError(
            f"actuator {part.name!r} is of kind {part.kind!r}; "
            f"actuator_kinds has {', '.join(specimen.actuator_kinds) or 'none'}."
        )
    if specimen.supply is None:
        raise ValueError("it has actuators but no supply; give its pressures.")
    joint = tree.joint(part.joint)
    if joint.kind is not JointKind.PRISMATIC:
        raise ValueError(
            f"actuator {part.name!r} is on joint {part.joint!r}, which is {joint.kind.name.lower()}; "
            "a cylinder needs a prismatic joint."
        )
    return DisplacementActuator(
        name=part.name,
        joint_position=joint.position_start,
        joint_velocity=joint.velocity_start,
        valve=kind.valve,
        cylinder=kind.cylinder,
        loop=kind.loop,
        supply=specimen.supply,
    )


def _transducer(channel: SpindleChannel, tree: MultibodyTree) -> Transducer:
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
    return Transducer(channel.name, joint.child, joint.frame_on_child.rotation, "xyz".index(channel.axis))


def _check_names(specimen: Specimen, elements: list[Element]) -> None:
    for what, names in (
        ("parts", [element.name for element in elements]),
        ("drives", [channel.name for channel in specimen.drives]),
        ("responses", [channel.name for channel in specimen.responses]),
        ("joints of actuators", [part.joint for part in specimen.actuators]),
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two {what} are called {twice[0]!r}; names must differ.")


def _check_drives(specimen: Specimen, elements: list[Element]) -> None:
    taken = [item for element in elements for item in element.inputs]
    listed = [Input(channel.name, channel.unit) for channel in specimen.drives]
    if taken != listed:
        raise ValueError(f"its parts take the drives {_listing(taken)}, in this order; listed are {_listing(listed)}.")
    for channel in specimen.drives:
        for element in elements:
            if not isinstance(element, DisplacementActuator) or element.name != channel.name:
                continue
            half = element.cylinder.half_stroke
            if max(channel.maximum, -channel.minimum) > half:
                raise ValueError(
                    f"drive {channel.name!r} goes from {channel.minimum:g} to {channel.maximum:g} m; "
                    f"its cylinder ends at {half:g} m either way."
                )


def _listing(inputs: list[Input]) -> str:
    return ", ".join(f"{item.name} [{item.unit}]" for item in inputs) or "none"
