"""Lightly damped structures: beams converted to modes, modes to a state space that is played exactly."""

from rig_sim.structure.rig import StructureRig, load_structure
from rig_sim.structure.specimen import KIND

__all__ = [
    "KIND",
    "StructureRig",
    "load_structure",
]
