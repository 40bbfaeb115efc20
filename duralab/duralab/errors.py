"""Errors of the SDK, each with one sentence.

LabError                    whatever goes wrong; the others are kinds of it
├── InputError              a value is not allowed, or a name is unknown or taken: correct it and ask again
├── NotReadyError           not in the state the lab is in: a rig is latched, a recording is still written
├── BusyError               the rig plays, or all workers of a service are taken: ask again later
├── StoppedError            somebody stopped it: a person, another script, or this one
├── LabTimeoutError         it took longer than was allowed, or a service is silent; a TimeoutError too
├── UnavailableError        who is asked is not on the bus, or left it before the answer
├── ServiceEndedError       a service that this process started ended by itself
└── CampaignFaultError      a campaign ended before its last playback
"""

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


class LabError(Exception):
    """The lab could not do what was asked.

    Parameters
    ----------
    message : str
        One sentence: what was wrong with which value, what is allowed, what to do.
    field : str
        Path of the value that was wrong, e.g. "update.iteration_gain"; empty where none is.
    service : str
        The service that found it, e.g. "rig_sim"; empty where none did.
    """

    def __init__(self, message: str, *, field: str = "", service: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.service = service


class InputError(LabError):
    """A value that the user gave is not allowed: correct it and ask again."""


class NotReadyError(LabError):
    """It cannot be done in the state the lab is in, e.g. a rig is latched: change that, then ask again."""


class BusyError(LabError):
    """The rig plays something else, or all workers of a service are taken: ask again later."""


class StoppedError(LabError):
    """It was stopped on request before it was done."""


class LabTimeoutError(LabError, TimeoutError):
    """It took longer than `timeout_seconds` allowed, or a service gave no sign of life."""


class UnavailableError(LabError):
    """The service is not on the bus, or left it before its answer."""


class ServiceEndedError(LabError):
    """A service of the lab ended unexpectedly; its last log line is in the message."""


class CampaignFaultError(LabError):
    """A campaign ended before its last playback."""


def ended(sentence: str) -> str:
    """Return a sentence with its full stop: a service may leave it out, and another sentence follows."""
    text = sentence.rstrip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def is_process_limit(error: BaseException | str) -> bool:
    """Return whether an error, or the text of one in a log, means that no further process or thread may start."""
    if isinstance(error, OSError):
        # A full pipe that does not block is EAGAIN as well, with its own text.
        return error.errno == errno.EAGAIN and error.strerror == os.strerror(errno.EAGAIN) and error.filename is None
    return any(part in str(error) for part in _NO_THREAD)
