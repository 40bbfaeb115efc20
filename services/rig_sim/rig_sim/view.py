"""Content of a rig's 3-D view: its bodies, the SDF's visuals, the actuators' cylinders, its elements as lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.geometry import Box, Convex, Cylinder, Mesh, ReadObjToTriangleSurfaceMesh, Role, SceneGraph, Sphere
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from duralab_gateway.motion import to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import rig_pb2
from rig_sim.compile import FOLDER_VARIABLE, cached_bytes, cached_model, compile_model
from rig_sim.elements import AntiRollBar, Strut, Tyre
from rig_sim.hydraulics import HydraulicActuator
from rig_sim.model import Assembly, SpindleForce
from rig_sim.multibody import Joint, MultibodyTree, Pose, SpringDamper, move

_NUMBERS = 12
_LARGEST_ERROR = 1.0e-9


class Poses:
    """Compiled forward kinematics of a tree: from Drake's positions to poses of all bodies except the world."""

    def __init__(self, tree: MultibodyTree, *, key: str) -> None:
        """Load the code of a key, which differs if the tree does, from disk if it was compiled before."""
        self.bodies = tuple(body.name for body in tree.bodies[1:])
        still = np.zeros(tree.velocity_count)

        def kinematics(positions: Any, _inputs: Any) -> tuple[list[Any], list[Any]]:
            poses = move(tree, positions, still).poses[1:]
            outputs = [number for pose in poses for number in [*np.asarray(pose.rotation).flat, *pose.origin]]
            return [0.0] * len(tree.default_positions), outputs

        names = tuple(f"{body} {index}" for body in self.bodies for index in range(_NUMBERS))
        self._compiled = cached_model(
            f"poses {key}",
            lambda: compile_model(
                kinematics,
                state_names=tuple(f"position {index}" for index in range(len(tree.default_positions))),
                input_names=(),
                output_names=names,
                # Some 10 µs for each drawn instant in both cases, and ready a quarter of a second sooner.
                lanes=False,
                optimization=0,
                shared=True,
            ),
        )

        # The content of a file may be wrong.
        design, found = tree.default_positions, self._compiled
        if (
            found.output_names != names
            or len(found.state_names) != len(design)
            or not np.allclose(
                found.outputs(design, np.zeros(0)),
                np.array(kinematics(design, ())[1], dtype=float),
                rtol=0.0,
                atol=_LARGEST_ERROR,
            )
        ):
            raise ValueError(
                "the compiled poses of the bodies disagree with the model; delete the folder of compiled code, "
                f"{FOLDER_VARIABLE} or ~/.cache/duralab/code."
            )

    def frames(self, positions: np.ndarray) -> np.ndarray:
        """Return rotation row by row, then origin in m, (instants, bodies, 12), of positions (instants, n_q)."""
        return self._compiled.outputs_at(positions, np.zeros(0)).reshape(len(positions), len(self.bodies), _NUMBERS)


def view_geometry(model_file: Path, assembly: Assembly, *, key: str) -> rig_pb2.RigDescription:
    """Return the drawn bodies, shapes and links of a rig's description.

    `model_file`: The SDF or URDF that the assembly's tree was read from. A visual that is not a box, cylinder, sphere
    or mesh is left out, and a mesh that is not OBJ is drawn as its convex hull. `key`: Differs if model file or
    assembly do; what was read for it before is taken from disk.
    """
    # A mesh or an included model is a file of its own, which the key does not contain.
    content = model_file.read_bytes()
    if b"<mesh" in content or b"<include" in content:
        return _drawn(model_file, assembly)
    kept = cached_bytes(f"geometry {key}", lambda: _drawn(model_file, assembly).SerializeToString(deterministic=True))
    return rig_pb2.RigDescription.FromString(kept)


def _drawn(model_file: Path, assembly: Assembly) -> rig_pb2.RigDescription:
    tree = assembly.tree
    actuators = [
        (element, _joint_at(tree, element.joint_position))
        for element in assembly.elements
        if isinstance(element, HydraulicActuator)
    ]
    pistons = {joint.child for _, joint in actuators}
    roles = dict.fromkeys(_wheels(assembly), rig_pb2.SHAPE_ROLE_WHEEL)
    roles |= dict.fromkeys(pistons, rig_pb2.SHAPE_ROLE_PISTON)
    drawn = rig_pb2.RigDescription(
        bodies=[body.name for body in tree.bodies[1:]], shapes=_visuals(model_file, tree, roles)
    )

    def link(name: str, kind: rig_pb2.LinkKind, *ends: Any) -> None:
        body_a, point_a, body_b, point_b = ends
        drawn.links.add(
            name=name,
            kind=kind,
            body_a=_name(tree, body_a),
            point_a=to_array(np.array(point_a, dtype=float)),
            body_b=_name(tree, body_b),
            point_b=to_array(np.array(point_b, dtype=float)),
        )

    for actuator, joint in actuators:
        shape, foot = _cylinder(actuator, joint, tree)
        drawn.shapes.append(shape)
        link(actuator.name, rig_pb2.LINK_KIND_ACTUATOR, joint.parent, foot, *_held(joint, tree))
    for spring in tree.springs:
        # An actuator's own line is already drawn along its rod.
        if not pistons & {spring.body_a, spring.body_b}:
            ends = (spring.body_a, spring.point_a, spring.body_b, spring.point_b)
            link(spring.name, rig_pb2.LINK_KIND_ROD, *ends)
    for element in assembly.elements:
        if isinstance(element, Strut):
            ends = (element.body_a, element.point_a, element.body_b, element.point_b)
            link(element.name, rig_pb2.LINK_KIND_STRUT, *ends)
        elif isinstance(element, AntiRollBar):
            # The bar between its pivots, and from each pivot one line for lever and link, whose joint is not a body.
            bar, kind = element.body, rig_pb2.LINK_KIND_ANTI_ROLL_BAR
            link(element.name, kind, bar, element.levers[0].pivot, bar, element.levers[1].pivot)
            for side, lever in zip(("left", "right"), element.levers, strict=True):
                link(f"{element.name}_{side}", kind, bar, lever.pivot, lever.link_body, lever.foot)
    return drawn


def _name(tree: MultibodyTree, body: int) -> str:
    """Return the name of a body in messages: empty for the world."""
    return tree.bodies[body].name if body else ""


def _pose(pose: Pose) -> np.ndarray:
    frame = np.concatenate([np.asarray(pose.rotation, dtype=float).ravel(), np.asarray(pose.origin, dtype=float)])
    return to_poses(frame[None, None])[0, 0]


def _visuals(model_file: Path, tree: MultibodyTree, roles: dict[int, rig_pb2.ShapeRole]) -> list[rig_pb2.RigShape]:
    # The player's own plant has no geometry: Drake keeps it in a scene graph, which the player does not need.
    plant, scene = MultibodyPlant(time_step=0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    Parser(plant).AddModels(model_file)
    plant.Finalize()
    inspector = scene.model_inspector()
    shapes: list[rig_pb2.RigShape] = []
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
        shapes.append(
            rig_pb2.RigShape(
                name=inspector.GetName(geometry).split("::")[-1],
                body=_name(tree, index),
                role=roles.get(index, rig_pb2.SHAPE_ROLE_SPECIMEN),
                pose=to_array(_pose(pose)),
                **solid,
            )
        )
    return shapes


def _wheels(assembly: Assembly) -> set[int]:
    tyres = {element.wheel for element in assembly.elements if isinstance(element, Tyre)}
    return tyres | {sensor.wheel for sensor in assembly.transducers if isinstance(sensor, SpindleForce)}


def _solid(shape: object) -> dict[str, Any] | None:
    """Return the field of a shape's message with its solid; None for one that is not drawn."""
    match shape:
        case Box():
            x, y, z = np.array(shape.size(), dtype=float)
            return {"box": rig_pb2.BoxShape(x=x, y=y, z=z)}
        case Cylinder():
            return {"cylinder": rig_pb2.CylinderShape(radius=shape.radius(), length=shape.length())}
        case Sphere():
            return {"sphere": rig_pb2.SphereShape(radius=shape.radius())}
        case Convex() | Mesh():
            vertices, triangles = _mesh(shape)
            corners = np.array(triangles, dtype=np.int64).ravel().tolist()
            return {"mesh": rig_pb2.MeshShape(vertices=to_array(vertices), corners=corners)}
        case _:
            return None


def _mesh(shape: Convex | Mesh) -> tuple[np.ndarray, list[list[int]]]:
    """Return vertices (vertices, 3) in m, and triangles of their indices."""
    if isinstance(shape, Mesh) and shape.extension() == ".obj" and shape.source().is_path():
        surface = ReadObjToTriangleSurfaceMesh(shape.source().path())
        vertices = np.array([surface.vertex(index) for index in range(surface.num_vertices())])
        elements = [surface.element(index) for index in range(surface.num_triangles())]
        return vertices * np.array(shape.scale3()), [[each.vertex(corner) for corner in range(3)] for each in elements]
    hull = shape.GetConvexHull()
    triangles = []
    for index in range(hull.num_faces()):
        face = hull.element(index)
        corners = [face.vertex(corner) for corner in range(face.num_vertices())]
        triangles += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    return np.array([hull.vertex(index) for index in range(hull.num_vertices())]), triangles


def _joint_at(tree: MultibodyTree, position: int) -> Joint:
    # Mounted actuators are on prismatic joints, whose one position is not shared.
    return next(joint for joint in tree.joints if joint.position_start == position and joint.axis.any())


def _cylinder(actuator: HydraulicActuator, joint: Joint, tree: MultibodyTree) -> tuple[rig_pb2.RigShape, np.ndarray]:
    """Return the cylinder, which is fixed, and its foot (3,) in the frame of the body that carries it."""
    frame = joint.frame_on_parent
    axis = frame.rotation @ joint.axis
    half = actuator.cylinder.half_stroke
    # The rod enters through the mouth on the specimen's side; fully in, its head is at the mouth.
    outward = 1.0 if float(joint.axis @ _reach(joint, tree)) >= 0.0 else -1.0
    mouth, foot = (frame.origin - outward * axis * half * count for count in (1.0, 3.0))
    # The stub uses the vector's shape as its element type.
    along = cast(Any, outward * axis)
    rotation = np.array(RotationMatrix.MakeFromOneVector(along, axis_index=2).matrix())
    # A piston with a rod of half its area, as usual: a bore of twice the area that the oil presses on.
    bore = float(np.sqrt(2.0 * actuator.cylinder.area / np.pi))
    shape = rig_pb2.RigShape(
        name=f"{actuator.name}_cylinder",
        body=_name(tree, joint.parent),
        role=rig_pb2.SHAPE_ROLE_CYLINDER,
        pose=to_array(_pose(Pose(rotation, (mouth + foot) / 2.0))),
        cylinder=rig_pb2.CylinderShape(radius=bore, length=2.0 * half),
    )
    return shape, foot


def _rod(joint: Joint, tree: MultibodyTree) -> SpringDamper | None:
    return next((spring for spring in tree.springs if joint.child in (spring.body_a, spring.body_b)), None)


def _held(joint: Joint, tree: MultibodyTree) -> tuple[int, np.ndarray]:
    """Return the body and point held by the actuator: the far end of its rod, or the piston itself."""
    rod = _rod(joint, tree)
    if rod is None:
        return joint.child, joint.frame_on_child.origin
    return (rod.body_b, rod.point_b) if rod.body_a == joint.child else (rod.body_a, rod.point_a)


def _reach(joint: Joint, tree: MultibodyTree) -> np.ndarray:
    """Return the vector from the piston to the held point, at the design position, in the joint's axes."""
    design = move(tree, tree.default_positions, np.zeros(tree.velocity_count)).poses
    held, point = _held(joint, tree)
    piston = design[joint.child] @ joint.frame_on_child
    place = design[held].rotation @ point + design[held].origin
    return (design[joint.parent] @ joint.frame_on_parent).rotation.T @ (place - piston.origin)
