"""The recorder: an MCAP log of everything a campaign does, and a live view of it in Rerun."""

from recorder.catalogue import describe, verify
from recorder.config import RecorderConfig
from recorder.live_view import LiveView
from recorder.mcap_log import McapLog
from recorder.recording_content import EPOCH, PART_METADATA, SCENARIO_METADATA, SOFTWARE_METADATA, STEP_TOPIC
from recorder.recording_files import Part, files_of, recordings_in
from recorder.recording_summary import SUMMARY_METADATA
from recorder.service import build

__all__ = [
    "EPOCH",
    "PART_METADATA",
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
    "files_of",
    "recordings_in",
    "verify",
]
