"""What a 3-D view of a rig shows: where its bodies are, their shapes, and the lines of its elements."""

from rig_sim.view.geometry import (
    BoxSolid,
    CylinderSolid,
    Link,
    LinkKind,
    MeshSolid,
    Shape,
    ShapeRole,
    SphereSolid,
    ViewGeometry,
    view_geometry,
)
from rig_sim.view.poses import Poses

__all__ = [
    "BoxSolid",
    "CylinderSolid",
    "Link",
    "LinkKind",
    "MeshSolid",
    "Poses",
    "Shape",
    "ShapeRole",
    "SphereSolid",
    "ViewGeometry",
    "view_geometry",
]
