"""Limits of a rig's drives: refusal or projection of a drive beyond one, and its cost for the target."""

from iterator.limits.drive_limits import (
    DriveLimitError,
    DriveLimits,
    DriveOverrunError,
    LimitQuantity,
    LimitViolation,
    drive_slew,
    held_share,
    require_small_overrun,
    require_within_limits,
)
from iterator.limits.drive_projection import DriveProjection, LimitPassing, project_drive
from iterator.limits.mapped_projection import (
    drive_within_limits,
    project_mapped_drive,
    require_rest_within_limits,
    wanted_drive,
)
from iterator.limits.unreachable import UnreachableSegment, unreachable_segments

__all__ = [
    "DriveLimitError",
    "DriveLimits",
    "DriveOverrunError",
    "DriveProjection",
    "LimitPassing",
    "LimitQuantity",
    "LimitViolation",
    "UnreachableSegment",
    "drive_slew",
    "drive_within_limits",
    "held_share",
    "project_drive",
    "project_mapped_drive",
    "require_rest_within_limits",
    "require_small_overrun",
    "require_within_limits",
    "unreachable_segments",
    "wanted_drive",
]
