"""Recordings: opening their files, and reading runs, playbacks and signals out of them."""

from duralab.recording.mcap_file import McapFile
from duralab.recording.parts import part_path, parts_beside
from duralab.recording.recording import Recording, open_recording

__all__ = [
    "McapFile",
    "Recording",
    "open_recording",
    "part_path",
    "parts_beside",
]
