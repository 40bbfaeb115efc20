"""Fault of a query as an exception."""

from __future__ import annotations

from typing import Final, Self

from duralab_proto.v1 import query_pb2

LONGEST_MESSAGE: Final = 1000
"""Most characters of a fault's sentence as it goes over the bus."""


class BusError(RuntimeError):
    """The bus could not be opened, or is closed; the message is one sentence that says why and what to do."""


class FaultError(Exception):
    """A query, or a step of it, failed.

    Raised by a handler it becomes the query's error reply; raised by `Bus.query` it is what the service, or the bus
    itself, found.

    Parameters
    ----------
    code : query_pb2.FaultCode
        The kind of failure.
    message : str
        One sentence: what was wrong with which value, what is allowed, what to do.
    field : str
        Path of the request's field that was wrong, e.g. "drive.samples"; empty where none is.
    service : str
        The service that found it; filled in by the bus when a handler leaves it empty.
    """

    def __init__(self, code: query_pb2.FaultCode, message: str, *, field: str = "", service: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field
        self.service = service

    @property
    def code_name(self) -> str:
        """The code as text, e.g. "INVALID_ARGUMENT"; a code of a newer contract as its number."""
        if self.code in query_pb2.FaultCode.values():
            return query_pb2.FaultCode.Name(self.code).removeprefix("FAULT_CODE_")
        return str(self.code)

    def to_message(self) -> query_pb2.Fault:
        """Return the fault as it goes over the bus."""
        # A value that is quoted may hold line breaks and have any length.
        line = " ".join(self.message.split())
        sentence = line if len(line) <= LONGEST_MESSAGE else f"{line[: LONGEST_MESSAGE - 1]}…"
        return query_pb2.Fault(code=self.code, message=sentence, field=self.field, service=self.service)

    @classmethod
    def from_message(cls, fault: query_pb2.Fault) -> Self:
        """Return the exception for a fault that came over the bus."""
        return cls(fault.code, fault.message, field=fault.field, service=fault.service)
