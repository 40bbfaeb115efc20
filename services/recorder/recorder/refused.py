"""Refusals of the recorder, independent of the bus."""

from __future__ import annotations

from duralab_proto.v1 import query_pb2


class RefusedError(Exception):
    """Refusal of a request.

    `code`: Reason, as named in the contract. `message`: One sentence with the wrong value, the allowed values and the
    remedy. `field`: Path of the request's wrong field; empty if there is none.
    """

    def __init__(self, code: query_pb2.FaultCode, message: str, *, field: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field


def invalid(message: str, *, field: str) -> RefusedError:
    """Return the refusal of a value that is not allowed."""
    return RefusedError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)
