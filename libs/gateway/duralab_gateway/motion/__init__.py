"""Playback of a drive on any rig, without bus and messages: ramps, blocks, watchdogs, use of the actuators."""

from duralab_gateway.motion.following import FollowedDrive
from duralab_gateway.motion.playback import (
    Approach,
    Block,
    DrivePlayback,
    RigFaultError,
    Use,
    lead_in,
    lead_out,
)
from duralab_gateway.motion.poses import to_poses
from duralab_gateway.motion.watchdogs import Level, Source, Watchdog, WatchdogMonitor, when

__all__ = [
    "Approach",
    "Block",
    "DrivePlayback",
    "FollowedDrive",
    "Level",
    "RigFaultError",
    "Source",
    "Use",
    "Watchdog",
    "WatchdogMonitor",
    "lead_in",
    "lead_out",
    "to_poses",
    "when",
]
