"""Rigs that play: a multibody specimen ready for drives, its playbacks, injected faults."""

from rig_sim.playing.faults import (
    DriftingGain,
    Fault,
    FaultKind,
    FaultySensors,
    NoisySensor,
    SensorFault,
    StuckSensor,
    SupplySag,
    ValveSaturation,
    sensor_faults,
    title_suffix,
)
from rig_sim.playing.playable import BLOCK_SAMPLES, KnowsItsFrf, PlayableRig, PlayableSpecimen
from rig_sim.playing.player import Playback, Rig, load_rig
from rig_sim.playing.software import software_hash

__all__ = [
    "BLOCK_SAMPLES",
    "DriftingGain",
    "Fault",
    "FaultKind",
    "FaultySensors",
    "KnowsItsFrf",
    "NoisySensor",
    "PlayableRig",
    "PlayableSpecimen",
    "Playback",
    "Rig",
    "SensorFault",
    "StuckSensor",
    "SupplySag",
    "ValveSaturation",
    "load_rig",
    "sensor_faults",
    "software_hash",
    "title_suffix",
]
