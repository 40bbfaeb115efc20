"""Log of the recordings: open recordings, the data that they accept, and their recovery."""

from recorder.log.archive import Archive
from recorder.log.folder_lock import exclusive_folder
from recorder.log.intake import Intake
from recorder.log.recording import Placement
from recorder.log.recovery import MEBIBYTE

__all__ = [
    "MEBIBYTE",
    "Archive",
    "Intake",
    "Placement",
    "exclusive_folder",
]
