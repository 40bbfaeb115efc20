"""Rigs that play: a multibody specimen ready for drives, its playbacks, injected faults."""

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
from rig_sim.playing.player import Playback, Rig, load_rig
from rig_sim.playing.simulated_playback import BLOCK_SAMPLES, SimulatedPlayback
from rig_sim.playing.software import content_hash

__all__ = [
    "BLOCK_SAMPLES",
    "Fault",
    "FaultKind",
    "NoisySensor",
    "Playback",
    "Rig",
    "SensorFault",
    "SimulatedPlayback",
    "StuckSensor",
    "ValveSaturation",
    "content_hash",
    "load_rig",
    "sensor_faults",
    "title_suffix",
]
