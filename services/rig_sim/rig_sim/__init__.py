"""Multibody test rigs with servo-hydraulic actuators: Drake is the model and the judge, compiled code plays."""

from duralab_gateway.motion import RigFaultError
from rig_sim.engines import Engine, EngineChoice
from rig_sim.loading import load_any_rig
from rig_sim.playing import Playback, Rig, load_rig
from rig_sim.specimen import Specimen, SpecimenError, load_specimen, shipped_specimens
from rig_sim.structure import PlayableRig

__all__ = [
    "Engine",
    "EngineChoice",
    "PlayableRig",
    "Playback",
    "Rig",
    "RigFaultError",
    "Specimen",
    "SpecimenError",
    "load_any_rig",
    "load_rig",
    "load_specimen",
    "shipped_specimens",
]
