"""Writing of MCAP files: schemas, messages that are durable when asked, and the ending of a file after a kill."""

from recorder.mcap.ending import finish
from recorder.mcap.schemas import holds_doubles_only
from recorder.mcap.writer import McapLog, sync_folder

__all__ = [
    "McapLog",
    "finish",
    "holds_doubles_only",
    "sync_folder",
]
