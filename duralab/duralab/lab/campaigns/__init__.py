"""Campaigns in a lab: running, resuming, fetching and recovering their recordings."""

from duralab.lab.campaigns.fetching import Recovery
from duralab.lab.campaigns.recordings_folder import RecordingsPlace, own_recordings
from duralab.lab.campaigns.result import CampaignResult
from duralab.lab.campaigns.running import (
    collect,
    expected_id,
    followed,
    free_id,
    recording_file,
    resume_campaign,
    stop_campaign,
)

__all__ = [
    "CampaignResult",
    "RecordingsPlace",
    "Recovery",
    "collect",
    "expected_id",
    "followed",
    "free_id",
    "own_recordings",
    "recording_file",
    "resume_campaign",
    "stop_campaign",
]
