"""Playbacks of a campaign: their settings, their playable drives, and their results."""

from iterator.playbacks.drives import playable_drive, require_within_bounds
from iterator.playbacks.maps import MapFromFirstPlayback, fitting_map, learned_map, mapped_drive
from iterator.playbacks.records import (
    NOTHING_KNOWN,
    CampaignResult,
    FirstDrive,
    Iteration,
    KnownBefore,
    RecordedPlayback,
)
from iterator.playbacks.settings import CampaignSettings

__all__ = [
    "NOTHING_KNOWN",
    "CampaignResult",
    "CampaignSettings",
    "FirstDrive",
    "Iteration",
    "KnownBefore",
    "MapFromFirstPlayback",
    "RecordedPlayback",
    "fitting_map",
    "learned_map",
    "mapped_drive",
    "playable_drive",
    "require_within_bounds",
]
