"""Queries to services: a fault becomes an error for the user, and the end of a service explains what it broke."""

from __future__ import annotations

from collections.abc import Callable
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
from duralab.lab.deadline import FOREVER, Deadline
from duralab_bus import Bus, FaultError
from duralab_proto.v1 import query_pb2

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


class LabClient:
    """A session on the bus, as the SDK asks through it.

    `bus`: The session. `failure`: Returns what happened to a service of this lab that ended by itself; None while all
    is well.
    """

    def __init__(self, bus: Bus, failure: Callable[[], LabError | None]) -> None:
        self.bus = bus
        self.failure = failure

    def key(self, what: str, make: Callable[[str], str], name: str) -> str:
        """Return the key made of a name; raises InputError with `what` as its field where none can be made."""
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
        """Ask and wait for the answer; raises LabError, where the deadline is over one about `what`."""
        try:
            cancel = deadline if deadline.limited else None
            return self.bus.query(key, request, kind, on_progress=on_progress, cancel=cancel)
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_CANCELLED and deadline.is_set():
                raise deadline.error(what) from fault
            raise self.explained(fault) from fault

    def explained(self, fault: FaultError) -> LabError:
        """Return a fault as an error for the user: the end of a service explains what it broke."""
        if (ended := self.failure()) is not None:
            return ended
        return _ERRORS.get(fault.code, LabError)(fault.message, field=fault.field, service=fault.service)
