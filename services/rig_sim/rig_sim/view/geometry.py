"""What a 3-D view draws of a rig: the SDF's visuals, the actuators' cylinders, lines along struts, rods and bars."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from pydrake.geometry import Box, Convex, Cylinder, Mesh, ReadObjToTriangleSurfaceMesh, Role, SceneGraph, Sphere
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from rig_sim.elements import AntiRollBar, Strut, Tyre
from rig_sim.hydraulics import HydraulicActuator
from rig_sim.model import Assembly, SpindleForce, SpindleMoment
from rig_sim.multibody import Joint, MultibodyTree, Pose, SpringDamper, move


@dataclass(frozen=True)
class BoxSolid:
    """Edges along x, y, z, in m; (3,)."""

    size: np.ndarray


@dataclass(frozen=True)
class CylinderSolid:
    """Along z, in m."""

    radius: float
    length: float


@dataclass(frozen=True)
class SphereSolid:
    """Radius in m."""

    radius: float


@dataclass(frozen=True)
class MeshSolid:
    """Vertices (vertices, 3) in m, and triangles (triangles, 3) of their indices."""

    vertices: np.ndarray
    triangles: np.ndarray


Solid: TypeAlias = BoxSolid | CylinderSolid | SphereSolid | MeshSolid


class ShapeRole(Enum):
    """What a solid is a part of."""

    SPECIMEN = auto()
    WHEEL = auto()
    PISTON = auto()
    CYLINDER = auto()


class LinkKind(Enum):
    """What a line stands for."""

    ACTUATOR = auto()
    STRUT = auto()
    ROD = auto()
    ANTI_ROLL_BAR = auto()


@dataclass(frozen=True)
class Shape:
    """A solid fixed to a body, by the body's index in the tree."""

    name: str
    body: int
    role: ShapeRole
    pose: Pose
    solid: Solid


@dataclass(frozen=True)
class Link:
    """A line between two points (3,) in m, each in the frame of its body."""

    name: str
    kind: LinkKind
    body_a: int
    point_a: np.ndarray
    body_b: int
    point_b: np.ndarray


@dataclass(frozen=True)
class ViewGeometry:
    """Everything that is drawn of a rig.

    `shapes`: Solids on the bodies. `links`: Lines between bodies.
    """

    shapes: tuple[Shape, ...]
    links: tuple[Link, ...]


def view_geometry(model_file: Path, assembly: Assembly) -> ViewGeometry:
    """Gather what is drawn of a rig.

    `model_file`: The SDF or URDF that the assembly's tree was read from. `assembly`: The tree with its elements.
    Returns: A visual that is no box, cylinder, sphere or mesh is left out, and a mesh that is no OBJ is its convex
    hull.
    """
    tree = assembly.tree
    actuators = [
        (element, _joint_at(tree, element.joint_position))
        for element in assembly.elements
        if isinstance(element, HydraulicActuator)
    ]
    pistons = {joint.child for _, joint in actuators}
    roles = dict.fromkeys(_wheels(assembly), ShapeRole.WHEEL) | dict.fromkeys(pistons, ShapeRole.PISTON)
    shapes = _visuals(model_file, tree, roles)
    links: list[Link] = []
    for actuator, joint in actuators:
        shape, link = _actuator(actuator, joint, tree)
        shapes.append(shape)
        links.append(link)
    for spring in tree.springs:
        # An actuator's own line already leads along its rod.
        if not pistons & {spring.body_a, spring.body_b}:
            ends = (spring.body_a, spring.point_a, spring.body_b, spring.point_b)
            links.append(Link(spring.name, LinkKind.ROD, *ends))
    for element in assembly.elements:
        match element:
            case Strut():
                ends = (element.body_a, element.point_a, element.body_b, element.point_b)
                links.append(Link(element.name, LinkKind.STRUT, *ends))
            case AntiRollBar():
                links += _anti_roll_bar(element)
            case _:
                pass
    return ViewGeometry(tuple(shapes), tuple(links))


def _visuals(model_file: Path, tree: MultibodyTree, roles: dict[int, ShapeRole]) -> list[Shape]:
    # The player's own plant has no geometry: Drake keeps it in a scene graph, which the player does not need.
    plant, scene = MultibodyPlant(time_step=0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    Parser(plant).AddModels(model_file)
    plant.Finalize()
    inspector = scene.model_inspector()
    shapes: list[Shape] = []
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        if body is None:
            continue
        index = tree.body_index(body.name())
        solid = _solid(inspector.GetShape(geometry))
        if solid is None:
            continue
        transform = inspector.GetPoseInFrame(geometry)
        pose = Pose(np.array(transform.rotation().matrix()), np.array(transform.translation()))
        name = inspector.GetName(geometry).split("::")[-1]
        shapes.append(Shape(name, index, roles.get(index, ShapeRole.SPECIMEN), pose, solid))
    return shapes


def _wheels(assembly: Assembly) -> set[int]:
    tyres = {element.wheel for element in assembly.elements if isinstance(element, Tyre)}
    return tyres | {sensor.wheel for sensor in assembly.transducers if isinstance(sensor, SpindleForce | SpindleMoment)}


def _solid(shape: object) -> Solid | None:
    match shape:
        case Box():
            return BoxSolid(np.array(shape.size(), dtype=float))
        case Cylinder():
            return CylinderSolid(shape.radius(), shape.length())
        case Sphere():
            return SphereSolid(shape.radius())
        case Convex() | Mesh():
            return _mesh(shape)
        case _:
            return None


def _mesh(shape: Convex | Mesh) -> MeshSolid:
    if isinstance(shape, Mesh) and shape.extension() == ".obj" and shape.source().is_path():
        surface = ReadObjToTriangleSurfaceMesh(shape.source().path())
        vertices = np.array([surface.vertex(index) for index in range(surface.num_vertices())])
        elements = [surface.element(index) for index in range(surface.num_triangles())]
        triangles = [[element.vertex(corner) for corner in range(3)] for element in elements]
        return MeshSolid(vertices * np.array(shape.scale3()), np.array(triangles, dtype=np.int64))
    hull = shape.GetConvexHull()
    triangles = []
    for index in range(hull.num_faces()):
        face = hull.element(index)
        corners = [face.vertex(corner) for corner in range(face.num_vertices())]
        triangles += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    vertices = np.array([hull.vertex(index) for index in range(hull.num_vertices())])
    return MeshSolid(vertices, np.array(triangles, dtype=np.int64))


def _joint_at(tree: MultibodyTree, position: int) -> Joint:
    # Mounted actuators sit on prismatic joints, whose one position is theirs alone.
    return next(joint for joint in tree.joints if joint.position_start == position and joint.axis.any())


def _actuator(actuator: HydraulicActuator, joint: Joint, tree: MultibodyTree) -> tuple[Shape, Link]:
    """Return the cylinder, which stands still, and the line from its foot to where the actuator holds the specimen."""
    frame = joint.frame_on_parent
    axis = frame.rotation @ joint.axis
    held, point = _held(joint, tree)
    half = actuator.cylinder.half_stroke
    # The rod goes in through the mouth on the specimen's side; fully in, its head is at the mouth.
    outward = 1.0 if float(joint.axis @ _reach(joint, tree)) >= 0.0 else -1.0
    mouth, foot = (frame.origin - outward * axis * half * count for count in (1.0, 3.0))
    # The stub takes the vector's shape for its element type.
    along = cast(Any, outward * axis)
    rotation = np.array(RotationMatrix.MakeFromOneVector(along, axis_index=2).matrix())
    # A piston with a rod of half its area, as usual: a bore of twice the area that the oil presses on.
    bore = float(np.sqrt(2.0 * actuator.cylinder.area / np.pi))
    shape = Shape(
        name=f"{actuator.name}_cylinder",
        body=joint.parent,
        role=ShapeRole.CYLINDER,
        pose=Pose(rotation, (mouth + foot) / 2.0),
        solid=CylinderSolid(bore, 2.0 * half),
    )
    return shape, Link(actuator.name, LinkKind.ACTUATOR, joint.parent, foot, held, point)


def _rod(joint: Joint, tree: MultibodyTree) -> SpringDamper | None:
    return next((spring for spring in tree.springs if joint.child in (spring.body_a, spring.body_b)), None)


def _held(joint: Joint, tree: MultibodyTree) -> tuple[int, np.ndarray]:
    """Return body and point that the actuator holds: the far end of its rod, or the piston itself."""
    rod = _rod(joint, tree)
    if rod is None:
        return joint.child, joint.frame_on_child.origin
    return (rod.body_b, rod.point_b) if rod.body_a == joint.child else (rod.body_a, rod.point_a)


def _reach(joint: Joint, tree: MultibodyTree) -> np.ndarray:
    """Return the way from the piston to what it holds, at the design position, in the joint's axes."""
    design = move(tree, tree.default_positions, np.zeros(tree.velocity_count)).poses
    held, point = _held(joint, tree)
    piston = design[joint.child] @ joint.frame_on_child
    place = design[held].rotation @ point + design[held].origin
    return (design[joint.parent] @ joint.frame_on_parent).rotation.T @ (place - piston.origin)


def _anti_roll_bar(bar: AntiRollBar) -> list[Link]:
    """Return the bar between its pivots, and from each pivot one line for lever and link: their joint is no body."""
    left, right = bar.levers
    links = [Link(bar.name, LinkKind.ANTI_ROLL_BAR, bar.body, left.pivot, bar.body, right.pivot)]
    for side, lever in zip(("left", "right"), bar.levers, strict=True):
        links.append(
            Link(f"{bar.name}_{side}", LinkKind.ANTI_ROLL_BAR, bar.body, lever.pivot, lever.link_body, lever.foot)
        )
    return links
