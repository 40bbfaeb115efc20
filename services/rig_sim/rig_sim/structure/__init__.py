"""Lightly damped structures: beams into modes, modes into a state space that is played exactly."""

from rig_sim.structure.modal_model import ModalModel, SampledModel
from rig_sim.structure.rig import StructureRig, load_structure
from rig_sim.structure.specimen import KIND, StructureSpecimen

__all__ = [
    "KIND",
    "ModalModel",
    "SampledModel",
    "StructureRig",
    "StructureSpecimen",
    "load_structure",
]
