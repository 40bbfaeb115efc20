"""Reader of the tree from a finalised Drake plant: Drake parses the SDF and alone decides its meaning."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree as Xml

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    BodyIndex,
    ForceElementIndex,
    Frame,
    FrameIndex,
    LinearBushingRollPitchYaw,
    LinearSpringDamper,
    PrismaticJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    WeldJoint,
)
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.multibody.tree import UniformGravityFieldElement as Gravity
from pydrake.systems.framework import Context

from rig_sim.multibody.tree import Body, Bushing, Joint, JointKind, MultibodyTree, Pose, SpringDamper

_KINDS = {
    WeldJoint: JointKind.WELD,
    RevoluteJoint: JointKind.REVOLUTE,
    PrismaticJoint: JointKind.PRISMATIC,
    BallRpyJoint: JointKind.BALL,
    QuaternionFloatingJoint: JointKind.FLOATING,
}


def load_plant(sdf: Path) -> MultibodyPlant:
    """Parse an SDF or a URDF into a finalised continuous plant; Drake's warnings are errors.

    Raises `ValueError` if there is no such file, or Drake cannot use it; the sentence contains Drake's message.
    """
    kind = "URDF" if sdf.suffix == ".urdf" else "SDF"
    if not sdf.is_file():
        raise ValueError(f"the {kind} {sdf.name} is missing; it belongs beside the specimen's YAML.")
    check_model_file(sdf)
    plant = MultibodyPlant(time_step=0.0)
    parser = Parser(plant)
    parser.SetStrictParsing()
    try:
        parser.AddModels(sdf)
        plant.Finalize()
    except RuntimeError as error:
        # The folder in Drake's message is removed: the reader of the message knows it.
        words = " ".join(str(error).split()).replace(f"/{sdf}", sdf.name).replace(str(sdf), sdf.name).rstrip(".")
        raise ValueError(f"the {kind} {sdf.name} cannot be used: {words}.") from error
    return plant


def read_tree(plant: MultibodyPlant) -> MultibodyTree:
    """Copy bodies, joints, springs, bushings and gravity out of a finalised plant, in Drake's order.

    Raises `ValueError` if the plant holds a joint or force element that the player does not support, two bodies or
    joints of one name, or a body without a connection.
    """
    context = plant.CreateDefaultContext()
    bodies = tuple(_body(plant, context, index) for index in range(plant.num_bodies()))
    joints = tuple(_joint(plant.get_joint(index)) for index in plant.GetJointIndices())
    _check_names("bodies", [body.name for body in bodies])
    _check_names("joints", [joint.name for joint in joints])
    springs: list[SpringDamper] = []
    bushings: list[Bushing] = []
    gravity = np.zeros(3)
    for index in range(plant.num_force_elements()):
        element = plant.get_force_element(ForceElementIndex(index))
        if isinstance(element, Gravity):
            gravity = element.gravity_vector()
        elif isinstance(element, LinearSpringDamper):
            springs.append(_spring(element))
        elif isinstance(element, LinearBushingRollPitchYaw):
            bushings.append(_bushing(element))
        else:
            raise ValueError(
                f"force element {type(element).__name__} is not supported by the player; "
                "use linear_spring_damper and linear_bushing_rpy in the SDF and the elements of the YAML."
            )
    return MultibodyTree(
        bodies=bodies,
        joints=_outward(joints),
        springs=tuple(springs),
        bushings=tuple(bushings),
        gravity=np.array(gravity),
        default_positions=np.array(plant.GetPositions(context), dtype=float),
        velocity_count=plant.num_velocities(),
        frames=_frames(plant),
    )


def _check_names(what: str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two {what} of the SDF are called {twice[0]!r}; give each its own name.")


def _frames(plant: MultibodyPlant) -> dict[str, tuple[int, Pose]]:
    frames = (plant.get_frame(FrameIndex(index)) for index in range(plant.num_frames()))
    return {frame.name(): (int(frame.body().index()), _pose(frame.GetFixedPoseInBodyFrame())) for frame in frames}


def _outward(joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Order joints so that every parent is reached before its children."""
    reached, ordered, waiting = {0}, [], list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in reached]
        if not ready:
            raise ValueError(f"joint {waiting[0].name!r} hangs on nothing that leads to the world.")
        ordered += ready
        reached.update(joint.child for joint in ready)
        waiting = [joint for joint in waiting if joint.child not in reached]
    return tuple(ordered)


def _body(plant: MultibodyPlant, context: Context, index: int) -> Body:
    body = plant.get_body(BodyIndex(index))
    if index == 0:
        return Body("world", 0.0, np.zeros(3), np.zeros((3, 3)))
    inertia = body.CalcSpatialInertiaInBodyFrame(context)
    rotational = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    return Body(body.name(), float(inertia.get_mass()), np.array(inertia.get_com()), np.array(rotational))


def _pose(transform: RigidTransform) -> Pose:
    return Pose(np.array(transform.rotation().matrix()), np.array(transform.translation()))


def _joint(joint: DrakeJoint) -> Joint:
    kind = _KINDS.get(type(joint))
    if kind is None:
        known = ", ".join(sorted(cls.__name__ for cls in _KINDS))
        raise ValueError(f"joint {joint.name()!r} is a {type(joint).__name__}; the player knows {known}.")
    axis = np.zeros(3)
    # Only the joint of a kind has its methods; the stubs have them on the subclass.
    own = cast(Any, joint)
    damping = np.atleast_1d(joint.default_damping_vector()) if kind is not JointKind.WELD else np.zeros(1)
    if np.any(damping != 0.0):
        raise ValueError(f"joint {joint.name()!r} has damping {damping}; put damping into a force element instead.")
    if kind is JointKind.REVOLUTE:
        axis = np.array(own.revolute_axis())
    elif kind is JointKind.PRISMATIC:
        axis = np.array(own.translation_axis())
    return Joint(
        name=joint.name(),
        kind=kind,
        parent=int(joint.parent_body().index()),
        child=int(joint.child_body().index()),
        frame_on_parent=_pose(joint.frame_on_parent().GetFixedPoseInBodyFrame()),
        frame_on_child=_pose(joint.frame_on_child().GetFixedPoseInBodyFrame()),
        axis=axis,
        position_start=joint.position_start() if joint.num_positions() else 0,
        positions=joint.num_positions(),
        velocity_start=joint.velocity_start() if joint.num_velocities() else 0,
        velocities=joint.num_velocities(),
    )


def _spring(element: LinearSpringDamper) -> SpringDamper:
    return SpringDamper(
        name=f"{element.bodyA().name()}–{element.bodyB().name()}",
        body_a=int(element.bodyA().index()),
        point_a=np.array(element.p_AP()).reshape(3),
        body_b=int(element.bodyB().index()),
        point_b=np.array(element.p_BQ()).reshape(3),
        free_length=float(element.free_length()),
        stiffness=float(element.stiffness()),
        damping=float(element.damping()),
    )


def _bushing(element: LinearBushingRollPitchYaw) -> Bushing:
    frame_a: Frame = element.frameA()
    frame_c: Frame = element.frameC()
    return Bushing(
        name=f"{frame_a.name()}–{frame_c.name()}",
        body_a=int(frame_a.body().index()),
        frame_a=_pose(frame_a.GetFixedPoseInBodyFrame()),
        body_c=int(frame_c.body().index()),
        frame_c=_pose(frame_c.GetFixedPoseInBodyFrame()),
        torque_stiffness=np.array(element.torque_stiffness_constants()),
        torque_damping=np.array(element.torque_damping_constants()),
        force_stiffness=np.array(element.force_stiffness_constants()),
        force_damping=np.array(element.force_damping_constants()),
    )


#: URDF tags that this simulator, or Drake for it, reads or may ignore. Drake's own tags have their prefix.
_KNOWN = {
    "robot": {
        "link",
        "joint",
        "frame",
        "material",
        "drake:joint",
        "drake:linear_bushing_rpy",
        "drake:linear_spring_damper",
    },
    "link": {"inertial", "visual", "collision"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
    "drake:joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
}
_DRAKE = "{https://drake.mit.edu}"
#: Endings of the tags of Drake's bushings and springs, for which Drake ends the process if the value is negative.
_NOT_NEGATIVE = ("_stiffness", "_damping")
_ABOVE_ZERO = "_free_length"
#: Number of values of each constant of a force element; Drake ignores one that it cannot read.
_NUMBERS = {"linear_bushing_rpy": 3, "linear_spring_damper": 1}
_WORLD = "world"


def check_model_file(path: Path) -> None:
    """Check the parts of the file that Drake does not check."""
    try:
        root = Xml.parse(path).getroot()
    except Xml.ParseError as error:
        raise ValueError(f"{path.name} is not XML: {error}.") from error
    urdf = path.suffix == ".urdf"
    if root.tag != ("robot" if urdf else "sdf"):
        raise ValueError(
            f"{path.name} begins with the tag {root.tag!r}; a {'URDF' if urdf else 'SDF'} begins with "
            f"{'robot' if urdf else 'sdf'!r}."
        )
    if urdf:
        _check_tags(path, root)
    for link in root.iter("link"):
        name = link.get("name", "")
        if name == _WORLD:
            continue
        mass = link.find("inertial/mass")
        if mass is None:
            raise ValueError(f"{path.name}: link {name!r} has no inertial with a mass; give it mass and inertia.")
        said = (mass.get("value", "") if urdf else mass.text or "").strip()
        if not _is_positive(said):
            raise ValueError(
                f"{path.name}: link {name!r} has the mass {said!r}; what moves needs a mass above 0 kg, what stands "
                "still a frame instead of a link."
            )
    for kind in _NUMBERS:
        for element in [*root.iter(f"{_DRAKE}{kind}"), *root.iter(f"drake:{kind}")]:
            _check_constants(path, kind, element)


def _check_constants(path: Path, kind: str, element: Xml.Element) -> None:
    for child in element:
        tag = child.tag.replace(_DRAKE, "drake:")
        if not tag.endswith((*_NOT_NEGATIVE, _ABOVE_ZERO)):
            continue
        said = (child.get("value") or child.text or "").strip()
        try:
            values = [float(number) for number in said.split()]
        except ValueError:
            values = []
        count = _NUMBERS[kind]
        allowed = "a length above 0 m" if tag.endswith(_ABOVE_ZERO) else "constants of 0 or more"
        if count > 1:
            allowed = f"{count} {allowed}"
        above = all(value > 0.0 if tag.endswith(_ABOVE_ZERO) else value >= 0.0 for value in values)
        if not (len(values) == count and above and all(math.isfinite(value) for value in values)):
            raise ValueError(f"{path.name}: {tag} of a {kind} is {said!r}; it takes {allowed}.")


def _is_positive(text: str) -> bool:
    try:
        return math.isfinite(float(text)) and float(text) > 0.0
    except ValueError:
        return False


def _check_tags(path: Path, parent: Xml.Element) -> None:
    tag = parent.tag.replace(_DRAKE, "drake:")
    for child in parent:
        name = child.tag.replace(_DRAKE, "drake:")
        if name not in _KNOWN[tag]:
            raise ValueError(
                f"{path.name}: tag {name!r} in {tag} {parent.get('name', '')!r} is unknown; known there are "
                f"{', '.join(sorted(_KNOWN[tag]))}."
            )
        if name in _KNOWN:
            _check_tags(path, child)
