"""Reading of recordings, in a folder or separate: list, steps, signals, audit."""

from recorder.reading.catalogue import describe, fits, read_part, verify
from recorder.reading.file_audit import audit
from recorder.reading.signal_windows import read_steps, read_window

__all__ = [
    "audit",
    "describe",
    "fits",
    "read_part",
    "read_steps",
    "read_window",
    "verify",
]
