"""Commanding of a rig by a service: storage of its steps, and rest of the rig."""

from duralab_bus.commanding.ending import early_end, halt_rig
from duralab_bus.commanding.recording_log import SAMPLES_LACK, RecordingLog
from duralab_bus.commanding.rig_admission import described_rig
from duralab_bus.commanding.rig_halt import bring_to_rest

__all__ = ["SAMPLES_LACK", "RecordingLog", "bring_to_rest", "described_rig", "early_end", "halt_rig"]
