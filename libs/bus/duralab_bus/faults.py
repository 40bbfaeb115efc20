"""Fault of a query as an exception."""

from __future__ import annotations

from typing import Final, Self

from duralab_proto.v1 import query_pb2

LONGEST_MESSAGE: Final = 1000
"""Largest number of characters of a fault's sentence on the bus."""


class BusError(RuntimeError):
    """The bus could not be opened, or is closed; the message is one sentence with the reason and the remedy."""


class FaultError(Exception):
    """Failure of a query or of one of its steps.

    Raised by a handler, it becomes the query's error reply; raised by `Bus.query`, it is the fault that the service
    or the bus itself found.

    Parameters
    ----------
    code : query_pb2.FaultCode
        Kind of failure.
    message : str
        One sentence: the wrong value, the allowed values, the remedy.
    field : str
        Path of the wrong field of the request, e.g. "drive.samples"; empty if there is none.
    service : str
        Service that found it; filled in by the bus when a handler leaves it empty.
    """

    def __init__(self, code: query_pb2.FaultCode, message: str, *, field: str = "", service: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field
        self.service = service

    @property
    def code_name(self) -> str:
        """Name of the code, e.g. "INVALID_ARGUMENT"; the number for a code of a newer contract."""
        if self.code in query_pb2.FaultCode.values():
            return query_pb2.FaultCode.Name(self.code).removeprefix("FAULT_CODE_")
        return str(self.code)

    def to_message(self) -> query_pb2.Fault:
        """Return the fault as a message of the contract."""
        # A quoted value may hold line breaks and have any length.
        line = " ".join(self.message.split())
        sentence = line if len(line) <= LONGEST_MESSAGE else f"{line[: LONGEST_MESSAGE - 1]}…"
        return query_pb2.Fault(code=self.code, message=sentence, field=self.field, service=self.service)

    @classmethod
    def from_message(cls, fault: query_pb2.Fault) -> Self:
        """Return the exception for a received fault."""
        return cls(fault.code, fault.message, field=fault.field, service=fault.service)
