"""Rigs that play: a multibody specimen ready for drives, its playbacks, the check of a drive, injected faults."""

from rig_sim.playing.actuator_use import Use
from rig_sim.playing.drive_check import DriveError, check_drive
from rig_sim.playing.faults import DriftingGain, Fault, FaultKind, NoisySensor, StuckSensor, SupplySag, ValveSaturation
from rig_sim.playing.playable import KnowsItsFrf, PlayableRig, PlayableRun, PlayableSpecimen
from rig_sim.playing.playback import Block
from rig_sim.playing.player import Playback, Rig, RigFaultError, load_rig

__all__ = [
    "Block",
    "DriftingGain",
    "DriveError",
    "Fault",
    "FaultKind",
    "KnowsItsFrf",
    "NoisySensor",
    "PlayableRig",
    "PlayableRun",
    "PlayableSpecimen",
    "Playback",
    "Rig",
    "RigFaultError",
    "StuckSensor",
    "SupplySag",
    "Use",
    "ValveSaturation",
    "check_drive",
    "load_rig",
]
