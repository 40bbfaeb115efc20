"""Spools of publishers for replay, in memory or on disk."""

from duralab_bus.spool.folder import SpoolFolder
from duralab_bus.spool.spool import SPOOL_BYTES, Spool, SpoolFullError, SpoolSpace

__all__ = [
    "SPOOL_BYTES",
    "Spool",
    "SpoolFolder",
    "SpoolFullError",
    "SpoolSpace",
]
