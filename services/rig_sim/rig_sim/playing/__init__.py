"""Rigs that play: a multibody specimen ready for drives, its playbacks, injected faults."""

from rig_sim.playing.batch import play_batch
from rig_sim.playing.faults import (
    Fault,
    FaultKind,
    NoisySensor,
    SensorFault,
    StuckSensor,
    ValveSaturation,
    sensor_faults,
    title_suffix,
)
from rig_sim.playing.player import FIRST_SPECIMEN, Playback, Rig, load_rig
from rig_sim.playing.simulated_playback import BLOCK_SAMPLES, SimulatedPlayback
from rig_sim.playing.software import content_hash
from rig_sim.playing.wear import Condition, Lost, WearState, gain_changes, lost_by
from rig_sim.playing.wear_file import WearFile

__all__ = [
    "BLOCK_SAMPLES",
    "FIRST_SPECIMEN",
    "Condition",
    "Fault",
    "FaultKind",
    "Lost",
    "NoisySensor",
    "Playback",
    "Rig",
    "SensorFault",
    "SimulatedPlayback",
    "StuckSensor",
    "ValveSaturation",
    "WearFile",
    "WearState",
    "content_hash",
    "gain_changes",
    "load_rig",
    "lost_by",
    "play_batch",
    "sensor_faults",
    "title_suffix",
]
