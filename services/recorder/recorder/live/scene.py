"""Placement of the solids and lines of a rig in the world, from the poses of its bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import rig_pb2

STAND_STILL: Final = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Pose of the world."""

SMALLEST_RADIUS: Final = 0.1
"""Smallest radius of an outline, in m: the camera must stay outside of the rig."""

Solid: TypeAlias = rig_pb2.BoxShape | rig_pb2.CylinderShape | rig_pb2.SphereShape | rig_pb2.MeshShape


@dataclass(frozen=True)
class Placed:
    """A solid on a body.

    `name`: Its name. `role`: Value of `duralab.v1.ShapeRole`. `body`: Index of its body in the poses; the number of
    bodies for the world. `pose`, shape (7): Shape to body: metres, then the unit quaternion w, x, y, z. `solid`: Its
    form and sizes.
    """

    name: str
    role: int
    body: int
    pose: np.ndarray
    solid: Solid


@dataclass(frozen=True)
class Line:
    """A line between two bodies; `kind` is a value of `duralab.v1.LinkKind`, points (3,) are in m in the bodies."""

    name: str
    kind: int
    body_a: int
    point_a: np.ndarray
    body_b: int
    point_b: np.ndarray


@dataclass(frozen=True)
class Scene:
    """Drawing of a rig.

    `bodies`: Number of poses at each instant. `rest`, shape (bodies, 7): Poses at rest.
    """

    bodies: int
    rest: np.ndarray
    solids: tuple[Placed, ...]
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class Outline:
    """Centre (3,) and radius of a ball around the rig at rest, in m, for the position of the camera."""

    centre: np.ndarray
    radius: float


def outline_of(scene: Scene) -> Outline:
    """Return a ball that holds all solids, in any orientation, and the ends of all lines at rest."""
    poses = with_world(scene.rest[None])
    points = [np.zeros((0, 3))]
    if scene.solids:
        centres = solid_poses(poses, scene.solids)[0][0]
        reach = np.array([[_reach(placed.solid)] for placed in scene.solids])
        points += [centres - reach, centres + reach]
    if scene.lines:
        points.append(line_ends(poses, scene.lines).reshape(-1, 3))
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    return Outline((low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, SMALLEST_RADIUS))


def _reach(solid: Solid) -> float:
    match solid:
        case rig_pb2.BoxShape():
            return math.hypot(solid.x, solid.y, solid.z) / 2.0
        case rig_pb2.CylinderShape():
            return math.hypot(solid.radius, solid.length / 2.0)
        case rig_pb2.SphereShape():
            return solid.radius
        case _:
            corners = from_array(solid.vertices, field="vertices")
            return float(np.linalg.norm(corners, axis=1).max(initial=0.0))


def read_scene(description: rig_pb2.RigDescription) -> Scene | None:
    """Return the checked scene of a rig's description; None if it describes no shapes."""
    if not description.bodies or not (description.shapes or description.links):
        return None
    places = {name: place for place, name in enumerate(description.bodies)} | {"": len(description.bodies)}
    rest = from_array(description.rest_poses, field="rest_poses", shape=(len(description.bodies), 7), dtype=np.float64)
    solids = tuple(_placed(shape, places, index) for index, shape in enumerate(description.shapes))
    lines = tuple(_line(link, places, index) for index, link in enumerate(description.links))
    return Scene(len(description.bodies), rest, solids, lines)


def _placed(shape: rig_pb2.RigShape, places: Mapping[str, int], index: int) -> Placed:
    field = f"shapes[{index}]"
    solid = _solid(shape, field)
    pose = from_array(shape.pose, field=f"{field}.pose", shape=(7,), dtype=np.float64)
    return Placed(shape.name, shape.role, _body(shape.body, places, f"{field}.body"), pose, solid)


def _solid(shape: rig_pb2.RigShape, field: str) -> Solid:
    match shape.WhichOneof("solid"):
        case "box":
            return shape.box
        case "cylinder":
            return shape.cylinder
        case "sphere":
            return shape.sphere
        case "mesh":
            corners = from_array(shape.mesh.vertices, field=f"{field}.mesh.vertices", shape=(None, 3), dtype=np.float64)
            triangles = shape.mesh.corners
            if len(triangles) % 3 or max(triangles, default=0) >= max(len(corners), 1):
                raise ArrayError(
                    f"{field}.mesh.corners must be three for each triangle, each below the {len(corners)} vertices.",
                    field=f"{field}.mesh.corners",
                )
            return shape.mesh
        case _:
            raise ArrayError(f"{field} has no form; a box, cylinder, sphere or mesh is asked for.", field=field)


def _line(link: rig_pb2.RigLink, places: Mapping[str, int], index: int) -> Line:
    field = f"links[{index}]"
    point_a, point_b = (
        from_array(point, field=f"{field}.{name}", shape=(3,), dtype=np.float64)
        for name, point in (("point_a", link.point_a), ("point_b", link.point_b))
    )
    body_a, body_b = (
        _body(body, places, f"{field}.{name}") for name, body in (("body_a", link.body_a), ("body_b", link.body_b))
    )
    return Line(link.name, link.kind, body_a, point_a, body_b, point_b)


def _body(name: str, places: Mapping[str, int], field: str) -> int:
    if name not in places:
        raise ArrayError(f"{field} is {name!r}; it must be one of `bodies`, or empty for the world.", field=field)
    return places[name]


def with_world(poses: np.ndarray) -> np.ndarray:
    """Append the pose of the world to those of the bodies."""
    return np.concatenate([poses, np.broadcast_to(STAND_STILL, (len(poses), 1, 7))], axis=1)


def turned(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotate vectors by unit quaternions."""
    w, axis = quaternions[..., :1], quaternions[..., 1:]
    return vectors + 2.0 * np.cross(axis, np.cross(axis, vectors) + w * vectors)


def chained(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Multiply quaternions: `inner` rotates first, then `outer`."""
    w, v = outer[..., :1], outer[..., 1:]
    x, u = inner[..., :1], inner[..., 1:]
    real = w * x - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([real, w * u + x * v + np.cross(v, u)], axis=-1)


def solid_poses(poses: np.ndarray, solids: Sequence[Placed]) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres and quaternions of solids in the world."""
    on = poses[:, [solid.body for solid in solids]]
    own = np.broadcast_to(np.array([solid.pose for solid in solids]).reshape(len(solids), 7), on.shape)
    return on[..., :3] + turned(on[..., 3:], own[..., :3]), chained(on[..., 3:], own[..., 3:])


def line_ends(poses: np.ndarray, lines: Sequence[Line]) -> np.ndarray:
    """Return the two end points of lines in the world."""
    bodies = [[line.body_a, line.body_b] for line in lines]
    points = np.array([[line.point_a, line.point_b] for line in lines])
    on = poses[:, bodies]
    return on[..., :3] + turned(on[..., 3:], np.broadcast_to(points, (*on.shape[:-1], 3)))
