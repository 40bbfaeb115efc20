"""What a 3-D view of a rig shows: where its bodies are, their shapes, and the lines of its elements."""

from rig_sim.view.geometry import view_geometry
from rig_sim.view.poses import to_poses

__all__ = [
    "to_poses",
    "view_geometry",
]
