"""The geometry of a rig in the contract's words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from duralab_gateway.motion import to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import rig_pb2
from rig_sim.multibody import Pose
from rig_sim.playing import Rig
from rig_sim.view import BoxSolid, CylinderSolid, Link, LinkKind, MeshSolid, Shape, ShapeRole, SphereSolid

_ROLES: Final = {
    ShapeRole.SPECIMEN: rig_pb2.SHAPE_ROLE_SPECIMEN,
    ShapeRole.WHEEL: rig_pb2.SHAPE_ROLE_WHEEL,
    ShapeRole.PISTON: rig_pb2.SHAPE_ROLE_PISTON,
    ShapeRole.CYLINDER: rig_pb2.SHAPE_ROLE_CYLINDER,
}
_KINDS: Final = {
    LinkKind.ACTUATOR: rig_pb2.LINK_KIND_ACTUATOR,
    LinkKind.STRUT: rig_pb2.LINK_KIND_STRUT,
    LinkKind.ROD: rig_pb2.LINK_KIND_ROD,
    LinkKind.ANTI_ROLL_BAR: rig_pb2.LINK_KIND_ANTI_ROLL_BAR,
}


def describe_view(rig: Rig, description: rig_pb2.RigDescription) -> None:
    """Add to a rig's description what a 3-D view needs.

    `rig`: At rest. `description`: Gets bodies, shapes, links and the poses at rest.
    """
    bodies = rig.poses.bodies
    description.bodies.extend(bodies)
    description.shapes.extend(shape_message(shape, bodies) for shape in rig.geometry.shapes)
    description.links.extend(link_message(link, bodies) for link in rig.geometry.links)
    rest = rig.poses.frames(rig.rest[: rig.model.position_count])
    description.rest_poses.CopyFrom(to_array(to_poses(rest[None])[0]))


def shape_message(shape: Shape, bodies: Sequence[str]) -> rig_pb2.RigShape:
    """Encode a solid; `bodies` are the names in the order of the pose stream, without the world."""
    message = rig_pb2.RigShape(
        name=shape.name, body=_name(shape.body, bodies), role=_ROLES[shape.role], pose=to_array(_pose(shape.pose))
    )
    match shape.solid:
        case BoxSolid(size):
            message.box.CopyFrom(rig_pb2.BoxShape(x=size[0], y=size[1], z=size[2]))
        case CylinderSolid(radius, length):
            message.cylinder.CopyFrom(rig_pb2.CylinderShape(radius=radius, length=length))
        case SphereSolid(radius):
            message.sphere.CopyFrom(rig_pb2.SphereShape(radius=radius))
        case MeshSolid(vertices, triangles):
            mesh = rig_pb2.MeshShape(vertices=to_array(vertices), corners=triangles.ravel().tolist())
            message.mesh.CopyFrom(mesh)
    return message


def link_message(link: Link, bodies: Sequence[str]) -> rig_pb2.RigLink:
    """Encode a line; `bodies` as for `shape_message`."""
    return rig_pb2.RigLink(
        name=link.name,
        kind=_KINDS[link.kind],
        body_a=_name(link.body_a, bodies),
        point_a=to_array(np.array(link.point_a, dtype=float)),
        body_b=_name(link.body_b, bodies),
        point_b=to_array(np.array(link.point_b, dtype=float)),
    )


def _name(body: int, bodies: Sequence[str]) -> str:
    # The tree counts the world as body 0.
    return "" if body == 0 else bodies[body - 1]


def _pose(pose: Pose) -> np.ndarray:
    frame = np.concatenate([np.asarray(pose.rotation, dtype=float).ravel(), np.asarray(pose.origin, dtype=float)])
    return to_poses(frame[None, None])[0, 0]
