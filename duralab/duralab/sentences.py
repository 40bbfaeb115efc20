"""Parts of sentences that several modules share."""

from __future__ import annotations

import errno
import os
from typing import Final

PROCESS_LIMIT: Final = (
    "the limit of processes and threads of this user or container is reached; end other processes, or raise the limit "
    "(`ulimit -u`, the container's pids limit)"
)
"""Reason and remedy where the system starts no further process or thread."""

# Python, Zenoh's runtime in Rust, and OpenBLAS.
_NO_THREAD: Final = ("can't start new thread", "can't spawn worker thread", "failed to spawn thread", "pthread_create")


def ended(sentence: str) -> str:
    """Return a sentence with its full stop: a service may leave it out, and another sentence follows."""
    text = sentence.rstrip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def is_process_limit(error: BaseException | str) -> bool:
    """Return whether an error, or the text of one in a log, means that no further process or thread may start."""
    if isinstance(error, OSError):
        # A full pipe that does not block is EAGAIN as well, with a text of its own.
        return error.errno == errno.EAGAIN and error.strerror == os.strerror(errno.EAGAIN) and error.filename is None
    return any(part in str(error) for part in _NO_THREAD)
