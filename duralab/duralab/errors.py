"""Errors of the SDK, each with one sentence.

LabError                    base class of all errors of the lab
├── InputError              a value is not allowed, or a name is unknown or taken: correct it and retry
├── NotReadyError           not possible in the lab's state: a rig is latched, a recording is still written
├── BusyError               the rig plays, or all workers of a service are busy: retry later
├── StoppedError            an operator, another script or this one stopped the call
├── LabTimeoutError         the call took longer than allowed, or a service is silent; also a TimeoutError
├── UnavailableError        the service is not on the bus, or left it before its answer
├── ServiceEndedError       a service that this process started ended unexpectedly
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
"""Reason and remedy if the system cannot start another process or thread."""

# Messages of Python, of Zenoh's runtime in Rust, and of OpenBLAS.
_NO_THREAD: Final = ("can't start new thread", "can't spawn worker thread", "failed to spawn thread", "pthread_create")


class LabError(Exception):
    """The lab could not do what was asked.

    Parameters
    ----------
    message : str
        One sentence: the wrong value, the allowed values, and the remedy.
    field : str
        Path of the wrong value, e.g. "update.iteration_gain"; empty if the error is not about a value.
    service : str
        Service that reported the error, e.g. "rig_sim"; empty if no service did.
    """

    def __init__(self, message: str, *, field: str = "", service: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.service = service


class InputError(LabError):
    """A value that the user gave is not allowed: correct it and retry."""


class NotReadyError(LabError):
    """The request is not possible in the lab's present state, e.g. a rig is latched: change the state, then retry."""


class BusyError(LabError):
    """The rig plays another run, or all workers of a service are busy: retry later."""


class StoppedError(LabError):
    """The call was stopped on request before it was complete."""


class LabTimeoutError(LabError, TimeoutError):
    """The call took longer than `timeout_seconds`, or a service sent no sign of life."""


class UnavailableError(LabError):
    """The service is not on the bus, or left it before its answer."""


class ServiceEndedError(LabError):
    """A service of the lab ended unexpectedly; its last log line is in the message."""


class CampaignFaultError(LabError):
    """A campaign ended before its last playback."""


def ended(sentence: str) -> str:
    """Return a sentence with its full stop: a service may omit it, and another sentence follows."""
    text = sentence.rstrip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def is_process_limit(error: BaseException | str) -> bool:
    """Return whether an error, or its text in a log, means that the limit of processes and threads is reached."""
    if isinstance(error, OSError):
        # A full non-blocking pipe also raises EAGAIN, but with another text.
        return error.errno == errno.EAGAIN and error.strerror == os.strerror(errno.EAGAIN) and error.filename is None
    return any(part in str(error) for part in _NO_THREAD)
