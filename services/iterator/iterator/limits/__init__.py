"""Limits of a rig's drives: a drive beyond one is refused or projected, and where that costs the target."""

from iterator.limits.drive_limits import (
    DriveLimitError,
    DriveLimits,
    DriveOverrunError,
    LimitQuantity,
    LimitViolation,
    held_share,
    require_small_overrun,
    require_within_limits,
)
from iterator.limits.drive_projection import DriveProjection, LimitPassing, project_drive
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
    "held_share",
    "project_drive",
    "require_small_overrun",
    "require_within_limits",
    "unreachable_segments",
]
