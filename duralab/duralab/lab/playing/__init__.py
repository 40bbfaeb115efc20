"""Playing one drive on a rig: the drive's source, its check, and the motion."""

from duralab.lab.playing.drive_file import read_drive_file
from duralab.lab.playing.motion import halting, play_drive, reset_rig, state_of_rig, stop_rig

__all__ = [
    "halting",
    "play_drive",
    "read_drive_file",
    "reset_rig",
    "state_of_rig",
    "stop_rig",
]
