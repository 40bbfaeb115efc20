"""Mount a specimen's parts on its tree: from names and design positions to elements with body indices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig_sim.elements import AntiRollBar, Lever, Rubber, Strut, Tyre
from rig_sim.hydraulics import HydraulicActuator, HydraulicSupply, Supply, all_supplies, check_limits, mount_actuator
from rig_sim.model.measurement import Sensor, mount_sensor
from rig_sim.model.wearing import WearingPart, mount_wear
from rig_sim.multibody import Body, Element, Input, Joint, JointKind, Motion, MultibodyTree, move
from rig_sim.specimen import (
    AntiRollBarPart,
    GainDrift,
    PartWear,
    RubberPart,
    Specimen,
    SpecimenError,
    StrutPart,
    TyrePart,
    mirrored_name,
)

_MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Assembly:
    """A tree with its mounted parts: elements, supplies last, a transducer per response, and wearing parts."""

    specimen: Specimen
    tree: MultibodyTree
    elements: tuple[Element, ...]
    transducers: tuple[Sensor, ...]
    wearing: tuple[WearingPart, ...] = ()


def assemble(specimen: Specimen, tree: MultibodyTree) -> Assembly:
    """Mount the parts of a specimen on the bodies, joints and frames of its SDF; a mirrored part gives two elements.

    Raises `SpecimenError` if a part names a body, frame, joint or kind that does not exist or does not fit, two
    parts or channels have one name, the parts' inputs are not the drives in their order, or a drive exceeds its
    cylinder.
    """
    design = move(tree, tree.default_positions, np.zeros(tree.velocity_count))
    elements: list[Element] = []
    try:
        supplies = all_supplies(specimen.supply, specimen.supplies)
        elements += [mount_actuator(part, specimen.actuator_kinds, supplies, tree) for part in specimen.actuators]
        for tyre in specimen.tyres:
            elements += [_tyre(tyre, tree, right=right) for right in _sides(mirrored=tyre.mirrored)]
        for strut in specimen.struts:
            elements += [_strut(strut, tree, design, right=right) for right in _sides(mirrored=strut.mirrored)]
        for rubber in specimen.rubber:
            elements += [_rubber(rubber, tree, right=right) for right in _sides(mirrored=rubber.mirrored)]
        elements += [_anti_roll_bar(bar, tree, design) for bar in specimen.anti_roll_bars]
        wearing = mount_wear([wear for wear in specimen.wear if isinstance(wear, PartWear)], tree, elements)
        # Last: a supply needs the flow to all actuators.
        elements += [HydraulicSupply(name, supply) for name, supply in supplies.items()]
        transducers = tuple(mount_sensor(channel, tree, design, elements) for channel in specimen.responses)
        _check_names(specimen, elements, wearing)
        for part in specimen.actuators:
            check_connected(tree, part.joint, actuator=part.name, mounted=_joined_bodies(elements))
        _check_drives(specimen, elements, wearing, supplies)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    return Assembly(specimen, tree, tuple(elements), transducers, wearing)


def _sides(*, mirrored: bool) -> tuple[bool, ...]:
    return (False, True) if mirrored else (False,)


def _named(name: str, *, right: bool) -> str:
    return mirrored_name(name) if right else name


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


def _anti_roll_bar(part: AntiRollBarPart, tree: MultibodyTree, design: Motion) -> AntiRollBar:
    body = tree.body_index(part.body)
    pose = design.poses[body]

    def lever(*, right: bool) -> Lever:
        mirror = _MIRROR if right else np.ones(3)
        pivot, end, foot = (np.array(point) * mirror for point in (part.pivot, part.lever_end, part.link_point))
        link_body = tree.body_index(_named(part.link_body, right=right))
        link_pose = design.poses[link_body]
        return Lever.at_design(
            pivot=pose.rotation.T @ (pivot - pose.origin),
            end=pose.rotation.T @ (end - pose.origin),
            axis=pose.rotation.T @ np.array([0.0, 1.0, 0.0]),
            foot=pose.rotation.T @ (foot - pose.origin),
            link_body=link_body,
            local_foot=link_pose.rotation.T @ (foot - link_pose.origin),
        )

    try:
        levers = (lever(right=False), lever(right=True))
    except ValueError as error:
        raise ValueError(f"anti-roll bar {part.name!r}: {error}.") from error
    return AntiRollBar(part.name, body, levers, part.law)


def _tyre(part: TyrePart, tree: MultibodyTree, *, right: bool) -> Tyre:
    inputs = tuple(
        Input(_named(drive, right=right), unit) for drive, unit in zip(part.drives, ("m", "1", "1", "m/s"), strict=True)
    )
    return Tyre(_named(part.name, right=right), tree.body_index(_named(part.wheel, right=right)), part.law, inputs)


def _check_names(specimen: Specimen, elements: list[Element], wearing: Sequence[WearingPart]) -> None:
    drifts = [wear for wear in specimen.wear if isinstance(wear, GainDrift)]
    channels = [channel.name for channel in specimen.responses]
    for drift in drifts:
        if drift.channel not in channels:
            raise ValueError(f"wear {drift.name!r} is of response {drift.channel!r}; there are {', '.join(channels)}.")
    for what, names in (
        ("wears", [part.name for part in wearing] + [drift.name for drift in drifts]),
        ("parts", [element.name for element in elements]),
        ("drives", [channel.name for channel in specimen.drives]),
        ("responses", [channel.name for channel in specimen.responses]),
        ("joints of actuators", [part.joint for part in specimen.actuators]),
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two {what} are called {twice[0]!r}; names must differ.")


def _joined_bodies(elements: list[Element]) -> list[set[int]]:
    """Return the bodies that each element of the YAML joins, by index."""
    joined: list[set[int]] = []
    for element in elements:
        match element:
            case Strut():
                joined.append({element.body_a, element.body_b})
            case Rubber():
                joined.append({element.body_a, element.body_c})
            case Tyre():
                joined.append({0, element.wheel})
            case AntiRollBar():
                joined += [{element.body, lever.link_body} for lever in element.levers]
            case _:
                pass
    return joined


def _check_drives(
    specimen: Specimen, elements: list[Element], wearing: Sequence[WearingPart], supplies: dict[str, Supply]
) -> None:
    lost = {item for part in wearing for item in part.inputs}
    taken = [item for element in elements for item in element.inputs if item not in lost]
    listed = [Input(channel.name, channel.unit) for channel in specimen.drives]
    if taken != listed:
        raise ValueError(f"its parts take the drives {_listing(taken)}, in this order; listed are {_listing(listed)}.")
    for channel in specimen.drives:
        for element in elements:
            if isinstance(element, HydraulicActuator) and element.name == channel.name:
                limits = {"minimum": channel.minimum, "maximum": channel.maximum}
                check_limits(element, supplies[element.supply], **limits)


def _listing(inputs: list[Input]) -> str:
    return ", ".join(f"{item.name} [{item.unit}]" for item in inputs) or "none"


def welded_groups(bodies: Sequence[Body], joints: Sequence[Joint]) -> list[set[int]]:
    """Return the groups of bodies that move as one, by index; the first group holds the world."""
    group_of = [{index} for index in range(len(bodies))]
    for joint in joints:
        if joint.kind is JointKind.WELD:
            merged = group_of[joint.parent] | group_of[joint.child]
            for index in merged:
                group_of[index] = merged
    return [group for index, group in enumerate(group_of) if index == min(group)]


def check_connected(tree: MultibodyTree, joint_name: str, *, actuator: str, mounted: Sequence[set[int]]) -> None:
    """Check that the body moved by an actuator is connected to others."""
    joint = tree.joint(joint_name)
    piston = next(group for group in welded_groups(tree.bodies, tree.joints) if joint.child in group)
    pairs = [{other.parent, other.child} for other in tree.joints if other.name != joint_name]
    pairs += [{spring.body_a, spring.body_b} for spring in tree.springs]
    pairs += [{bushing.body_a, bushing.body_c} for bushing in tree.bushings]
    if len(piston) == 1 and not any(pair & piston and pair - piston for pair in [*pairs, *mounted]):
        raise ValueError(
            f"actuator {actuator!r} moves {tree.bodies[joint.child].name!r}, to which nothing is connected; join it to "
            "the specimen by a joint, spring, bushing or strut."
        )
