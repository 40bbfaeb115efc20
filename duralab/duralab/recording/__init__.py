"""Recordings: open their files, and read runs, playbacks and signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.recording.endurance import EnduranceRecording, EnduranceRepeats
    from duralab.recording.files import RecordingFiles, parts_beside
    from duralab.recording.recording import Recording, open_recording

__all__ = [
    "EnduranceRecording",
    "EnduranceRepeats",
    "Recording",
    "RecordingFiles",
    "open_recording",
    "parts_beside",
]

__getattr__ = lazy_face(__name__)
