"""The room that is kept free on the recordings' disk."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from recorder.log.recording import DiskError, as_disk_error

MEBIBYTE: Final = 1024 * 1024
LEAST_FREE_BYTES: Final = 256 * MEBIBYTE


@dataclass(frozen=True)
class FreeRoom:
    """How much must be free before something is begun.

    Parameters
    ----------
    folder : Path
        On the disk in question.
    least_bytes : int
        0 or more.
    """

    folder: Path
    least_bytes: int

    def expect(self, recording: str) -> None:
        """Raise a DiskError while too little is free: a playback that has begun should find its place."""
        with as_disk_error(recording):
            free = shutil.disk_usage(self.folder).free
        if free < self.least_bytes:
            raise DiskError(
                recording, f"{free // MEBIBYTE} MiB are free, {self.least_bytes // MEBIBYTE} MiB are kept free"
            )
