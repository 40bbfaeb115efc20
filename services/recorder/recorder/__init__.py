"""The recorder: an MCAP log of everything a campaign does, and a live view of it in Rerun."""

from recorder.catalogue import Part, describe, recordings_in, verify
from recorder.config import RecorderConfig
from recorder.live_view import LiveView
from recorder.mcap_log import McapLog
from recorder.recording import EPOCH, SCENARIO_METADATA, SOFTWARE_METADATA, STEP_TOPIC, SUMMARY_METADATA
from recorder.service import build

__all__ = [
    "EPOCH",
    "SCENARIO_METADATA",
    "SOFTWARE_METADATA",
    "STEP_TOPIC",
    "SUMMARY_METADATA",
    "LiveView",
    "McapLog",
    "Part",
    "RecorderConfig",
    "build",
    "describe",
    "recordings_in",
    "verify",
]
