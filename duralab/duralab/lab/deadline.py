"""How long a caller waits for the lab: until a moment, until somebody says enough, or for ever."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from numbers import Real

from duralab.errors import InputError, LabError, LabTimeoutError, StoppedError


@dataclass(frozen=True)
class Deadline:
    """When to give up; `duralab_bus` asks it as it asks an event.

    `timeout_seconds`: The time allowed, as the caller said it; infinite where all the time in the world is. `deadline`:
    When it is over, of `time.monotonic`. `cancel`: Set from another thread, ends the wait.
    """

    timeout_seconds: float = math.inf
    deadline: float = math.inf
    cancel: threading.Event | None = None

    @property
    def limited(self) -> bool:
        """Whether it can ever end."""
        return self.cancel is not None or self.deadline < math.inf

    def is_set(self) -> bool:
        """Whether it is over."""
        return (self.cancel is not None and self.cancel.is_set()) or time.monotonic() >= self.deadline

    def error(self, what: str) -> LabError:
        """Return why it is over, about `what`, the begin of a sentence."""
        if self.cancel is not None and self.cancel.is_set():
            return StoppedError(f"{what} was stopped by the script that asked for it.")
        return LabTimeoutError(f"{what} took longer than the {self.timeout_seconds:g} s allowed.")


FOREVER = Deadline()
"""Without an end."""


def deadline_of(timeout_seconds: float | None, cancel: threading.Event | None) -> Deadline:
    """Return the deadline of a call that begins now."""
    if cancel is not None and not isinstance(cancel, threading.Event):
        raise InputError(f"cancel is {cancel!r}; give a threading.Event, or leave it out.", field="cancel")
    if timeout_seconds is None:
        return Deadline(cancel=cancel)
    require_time(timeout_seconds, field="timeout_seconds")
    return Deadline(timeout_seconds, time.monotonic() + timeout_seconds, cancel)


def require_time(seconds: object, *, field: str) -> None:
    """Check a time that somebody is willing to wait."""
    if not isinstance(seconds, Real) or isinstance(seconds, bool) or not float(seconds) > 0.0:
        raise InputError(f"{field} is {seconds!r}; it must be a number greater than 0, or left out.", field=field)
