"""Commanding of a rig by a service: its admission, the storage of its steps, its status and holds, and rest."""

from duralab_bus.commanding.admissions import Admissions, Admitted, already_exists
from duralab_bus.commanding.ending import early_end, halt_rig
from duralab_bus.commanding.open_hold import OpenHold
from duralab_bus.commanding.reading_back import damaged_recording, message_of_step, recorded_steps
from duralab_bus.commanding.recording_log import SAMPLES_LACK, RecordingLog
from duralab_bus.commanding.rig_admission import described_rig
from duralab_bus.commanding.rig_halt import bring_to_rest
from duralab_bus.commanding.status_board import StatusBoard

__all__ = [
    "SAMPLES_LACK",
    "Admissions",
    "Admitted",
    "OpenHold",
    "RecordingLog",
    "StatusBoard",
    "already_exists",
    "bring_to_rest",
    "damaged_recording",
    "described_rig",
    "early_end",
    "halt_rig",
    "message_of_step",
    "recorded_steps",
]
