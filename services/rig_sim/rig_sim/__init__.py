"""Multibody test rigs with servo-hydraulic actuators, modelled and verified with Drake, played by compiled code."""

from duralab_gateway.motion import RigFaultError
from rig_sim.engines import Engine, EngineChoice
from rig_sim.loading import PlayableRig, load_any_rig
from rig_sim.playing import Condition, Lost, Playback, Rig, WearState, load_rig, play_batch
from rig_sim.specimen import Specimen, SpecimenError, load_specimen, shipped_specimens

__all__ = [
    "Condition",
    "Engine",
    "EngineChoice",
    "Lost",
    "PlayableRig",
    "Playback",
    "Rig",
    "RigFaultError",
    "Specimen",
    "SpecimenError",
    "WearState",
    "load_any_rig",
    "load_rig",
    "load_specimen",
    "play_batch",
    "shipped_specimens",
]
