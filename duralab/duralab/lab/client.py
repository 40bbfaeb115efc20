"""Queries to services: a fault becomes an error for the user; if a service has ended, that is the error."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Final, TypeVar

from google.protobuf.message import Message

from duralab.errors import (
    BusyError,
    InputError,
    LabError,
    LabTimeoutError,
    NotReadyError,
    StoppedError,
    UnavailableError,
)
from duralab_bus import Bus, FaultError
from duralab_proto.keys import ANY
from duralab_proto.v1 import query_pb2


@dataclass(frozen=True)
class Deadline:
    """Deadline, in `time.monotonic`, and cancellation of a blocking call; `duralab_bus` uses it like an event."""

    timeout_seconds: float = math.inf
    deadline: float = math.inf
    cancel: threading.Event | None = None

    @property
    def limited(self) -> bool:
        """Whether there is a deadline or a cancellation."""
        return self.cancel is not None or self.deadline < math.inf

    def is_set(self) -> bool:
        """Return whether the deadline has passed or the call is cancelled."""
        return (self.cancel is not None and self.cancel.is_set()) or time.monotonic() >= self.deadline

    def error(self, what: str) -> LabError:
        """Return the error of an ended call; `what` is the subject of its sentence."""
        if self.cancel is not None and self.cancel.is_set():
            return StoppedError(f"{what} was stopped by the script that asked for it.")
        return LabTimeoutError(f"{what} took longer than the {self.timeout_seconds:g} s allowed.")


FOREVER = Deadline()
"""Deadline without limit."""


def deadline_of(timeout_seconds: float | None, cancel: threading.Event | None) -> Deadline:
    """Return the deadline and cancellation of a call that begins now."""
    if cancel is not None and not isinstance(cancel, threading.Event):
        raise InputError(f"cancel is {cancel!r}; give a threading.Event, or leave it out.", field="cancel")
    if timeout_seconds is None:
        return Deadline(cancel=cancel)
    require_time(timeout_seconds, field="timeout_seconds")
    return Deadline(timeout_seconds, time.monotonic() + timeout_seconds, cancel)


def require_time(seconds: object, *, field: str) -> None:
    """Check a timeout in seconds."""
    if not isinstance(seconds, Real) or isinstance(seconds, bool) or not float(seconds) > 0.0:
        raise InputError(f"{field} is {seconds!r}; it must be a number greater than 0, or left out.", field=field)


_ERRORS: Final = MappingProxyType(
    {
        query_pb2.FAULT_CODE_INVALID_ARGUMENT: InputError,
        query_pb2.FAULT_CODE_NOT_FOUND: InputError,
        query_pb2.FAULT_CODE_ALREADY_EXISTS: InputError,
        query_pb2.FAULT_CODE_BUSY: BusyError,
        query_pb2.FAULT_CODE_FAILED_PRECONDITION: NotReadyError,
        query_pb2.FAULT_CODE_CANCELLED: StoppedError,
        query_pb2.FAULT_CODE_UNAVAILABLE: UnavailableError,
        query_pb2.FAULT_CODE_DEADLINE_EXCEEDED: LabTimeoutError,
    }
)

MessageT = TypeVar("MessageT", bound=Message)


def recordings_key(bus: Bus) -> str:
    """Return the key that lists all recordings that this member may read."""
    project = bus.member.project if bus.member is not None else ""
    return bus.keys.project_recordings(project) if project else bus.keys.recordings()


def require_one(key: str) -> None:
    """Refuse a key with a wildcard: a query goes to one service only."""
    if ANY in key:
        raise InputError(f"The name {ANY!r} stands for all, which can only be watched; give the name of one.")


class LabClient:
    """Session of the SDK on the bus; `failure` returns the error of a service of this lab that has ended, or None."""

    def __init__(self, bus: Bus, failure: Callable[[], LabError | None]) -> None:
        self.bus = bus
        self.failure = failure

    def key(self, what: str, make: Callable[[str], str], name: str) -> str:
        """Return the key made from a name; raises InputError with `what` as its field if the name is not allowed."""
        if not isinstance(name, str):
            raise InputError(f"{what} is {name!r}; give its name as a text.", field=what)
        try:
            return make(name)
        except ValueError as error:
            raise InputError(str(error), field=what) from error

    def query(
        self,
        key: str,
        request: Message,
        kind: type[MessageT],
        *,
        on_progress: Callable[[query_pb2.Progress], None] | None = None,
        deadline: Deadline = FOREVER,
        what: str = "The answer",
    ) -> MessageT:
        """Send a query and wait for the answer; raises LabError, after the deadline one about `what`."""
        require_one(key)
        try:
            cancel = deadline if deadline.limited else None
            return self.bus.query(key, request, kind, on_progress=on_progress, cancel=cancel)
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_CANCELLED and deadline.is_set():
                raise deadline.error(what) from fault
            raise self.explained(fault) from fault

    def explained(self, fault: FaultError) -> LabError:
        """Return a fault as an error for the user; if a service has ended, return that error."""
        if (ended := self.failure()) is not None:
            return ended
        return _ERRORS.get(fault.code, LabError)(fault.message, field=fault.field, service=fault.service)
