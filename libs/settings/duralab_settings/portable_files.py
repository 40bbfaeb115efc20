"""Differences of files between POSIX and Windows: opening one for bytes, and locking it for a process."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

OPEN_BINARY: Final = os.O_BINARY if sys.platform == "win32" else 0
"""Flag of `os.open` without which Windows changes line endings."""

if sys.platform == "win32":
    import msvcrt

    def _claim(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _claim(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def lock_file(path: Path) -> int:
    """Open a file and lock it for this process, until the descriptor is closed or the process ends.

    Parameters
    ----------
    path : Path
        Path of the file; an empty one is made if it does not exist.

    Returns
    -------
    int
        Descriptor that holds the lock.

    Raises
    ------
    OSError
        If another process has locked it, or it cannot be opened for writing.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | OPEN_BINARY, 0o644)
    try:
        _claim(descriptor)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
