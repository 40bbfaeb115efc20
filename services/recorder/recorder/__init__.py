"""The recorder: an MCAP log of everything a campaign does, and a live view of it in Rerun."""

from recorder.config import RecorderConfig
from recorder.service import build

__all__ = ["RecorderConfig", "build"]
