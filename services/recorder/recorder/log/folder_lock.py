"""Folder of the recordings: writable, and locked by one recorder while its process runs."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from duralab_bus import ConfigError

LOCK: Final = ".recorder"
"""Lock file, whose content is not used: the lock is released with the process, however that ends."""


@contextmanager
def exclusive_folder(folder: Path) -> Iterator[None]:
    """Make the folder, check that files can be made in it, and lock it against other recorders.

    A second recorder would treat the files that the first one writes as abandoned, and cut them off.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ConfigError(
            f"The recorder cannot write in folder {str(folder)!r}: {error.strerror or error}; correct `folder`."
        ) from error
    try:
        _lock(lock, folder)
        yield
    finally:
        os.close(lock)


def _lock(descriptor: int, folder: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(
            f"Another recorder writes in folder {str(folder)!r}; end it first or give another `folder`."
        ) from error
    except OSError as error:
        raise ConfigError(
            f"The folder {str(folder)!r} cannot be locked: {error.strerror or error}; give a `folder` on a disk "
            "of this machine."
        ) from error
