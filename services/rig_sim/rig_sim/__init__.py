"""Multibody test rigs with servo-hydraulic actuators: Drake is the model and the judge, compiled code plays."""

from rig_sim.player import Block, Playback, Rig, RigFaultError, Use, load_rig
from rig_sim.specimen import Specimen, SpecimenError, load_specimen, shipped_specimens

__all__ = [
    "Block",
    "Playback",
    "Rig",
    "RigFaultError",
    "Specimen",
    "SpecimenError",
    "Use",
    "load_rig",
    "load_specimen",
    "shipped_specimens",
]
