"""Rigs that play: a multibody specimen ready for drives, its playbacks, injected faults."""

from rig_sim.playing.faults import DriftingGain, Fault, FaultKind, NoisySensor, StuckSensor, SupplySag, ValveSaturation
from rig_sim.playing.playable import KnowsItsFrf, PlayableRig, PlayableSpecimen
from rig_sim.playing.player import Playback, Rig, load_rig

__all__ = [
    "DriftingGain",
    "Fault",
    "FaultKind",
    "KnowsItsFrf",
    "NoisySensor",
    "PlayableRig",
    "PlayableSpecimen",
    "Playback",
    "Rig",
    "StuckSensor",
    "SupplySag",
    "ValveSaturation",
    "load_rig",
]
