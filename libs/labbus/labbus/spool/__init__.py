"""What publishers keep for replay, in memory or on disk."""

from labbus.spool.folder import SpoolFolder
from labbus.spool.spool import SPOOL_BYTES, Spool, SpoolFullError, SpoolSpace

__all__ = [
    "SPOOL_BYTES",
    "Spool",
    "SpoolFolder",
    "SpoolFullError",
    "SpoolSpace",
]
