"""Recordings: opening their files, and reading runs, playbacks and signals out of them."""

from duralab.recording.files import RecordingFiles, parts_beside
from duralab.recording.recording import Recording, open_recording

__all__ = [
    "Recording",
    "RecordingFiles",
    "open_recording",
    "parts_beside",
]
