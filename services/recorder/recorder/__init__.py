"""The recorder: an MCAP log of everything a campaign does, and a live view of it in Rerun."""

from recorder.config import RecorderConfig
from recorder.format import (
    SCENARIO_METADATA,
    SOFTWARE_METADATA,
    STEP_TOPIC,
    Part,
    files_of,
    recordings_in,
)
from recorder.live import LiveView
from recorder.mcap_log import McapLog
from recorder.reading import describe, verify
from recorder.service import build

__all__ = [
    "SCENARIO_METADATA",
    "SOFTWARE_METADATA",
    "STEP_TOPIC",
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
