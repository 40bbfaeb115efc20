"""Asking services: a fault becomes an error for the user, and the end of a service explains what it broke."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from google.protobuf.message import Message

from duralab.errors import InputError, LabError
from duralab_proto.v1 import query_pb2
from labbus import Bus, FaultError

_INPUT_FAULTS: Final = frozenset(
    {
        query_pb2.FAULT_CODE_INVALID_ARGUMENT,
        query_pb2.FAULT_CODE_NOT_FOUND,
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
    }
)

MessageT = TypeVar("MessageT", bound=Message)


class Asking:
    """A session on the bus, as the SDK asks through it.

    Parameters
    ----------
    bus : Bus
        The session.
    failure : callable
        Returns what happened to a service of this lab that ended by itself; None while all is well.
    """

    def __init__(self, bus: Bus, failure: Callable[[], LabError | None]) -> None:
        self.bus = bus
        self.failure = failure

    def key(self, what: str, make: Callable[[str], str], name: str) -> str:
        """Return the key made of a name; raises InputError with `what` as its field where none can be made."""
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
    ) -> MessageT:
        """Ask and wait for the answer; raises LabError."""
        try:
            return self.bus.query(key, request, kind, on_progress=on_progress)
        except FaultError as fault:
            raise self.explained(fault) from fault

    def explained(self, fault: FaultError) -> LabError:
        """Return a fault as an error for the user: the end of a service explains what it broke."""
        if (ended := self.failure()) is not None:
            return ended
        kind = InputError if fault.code in _INPUT_FAULTS else LabError
        return kind(fault.message, field=fault.field, service=fault.service)
