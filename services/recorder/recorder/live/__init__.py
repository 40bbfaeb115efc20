"""The live view in Rerun: from the streams of a campaign, or from its log."""

from recorder.live.rebuild import Shown, UnreadableFileError, recording_of, show_log
from recorder.live.view import LiveView
from recorder.live.views import LiveViews

__all__ = [
    "LiveView",
    "LiveViews",
    "Shown",
    "UnreadableFileError",
    "recording_of",
    "show_log",
]
