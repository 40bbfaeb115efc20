"""Refusals of the recorder, independent of the bus."""

from __future__ import annotations

from duralab_proto.v1 import query_pb2


class RefusedError(Exception):
    """A request that is not granted.

    `code`: Why, as the contract names it. `message`: One sentence: what was wrong with which value, what is allowed,
    what to do. `field`: Path of the request's field that was wrong; empty where none is.
    """

    def __init__(self, code: query_pb2.FaultCode, message: str, *, field: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field


def invalid(message: str, *, field: str) -> RefusedError:
    """Return the refusal of a value that is not allowed."""
    return RefusedError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)
