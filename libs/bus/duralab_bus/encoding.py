"""Encoding of messages on the bus: protobuf, with the message's type in the encoding."""

from __future__ import annotations

from functools import cache
from typing import TypeVar

import zenoh
from google.protobuf.message import DecodeError, Message

from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2

MessageT = TypeVar("MessageT", bound=Message)


def encoding_of(message_type: Message | type[Message]) -> str:
    """Return the encoding of a message or message type: `application/protobuf;<full name>`.

    Parameters
    ----------
    message_type : Message or type
        Message or type of the contract.

    Returns
    -------
    str
        Encoding that is sent with the payload.
    """
    return f"application/protobuf;{message_type.DESCRIPTOR.full_name}"


@cache
def zenoh_encoding_of(message_type: type[Message]) -> zenoh.Encoding:
    """Return the encoding of a message type as a Zenoh object; comparing it does not parse its text again."""
    return zenoh.Encoding(encoding_of(message_type))


def encode(
    message: Message,
    *,
    largest_bytes: int,
    code: query_pb2.FaultCode = query_pb2.FAULT_CODE_INVALID_ARGUMENT,
) -> bytes:
    """Serialise a message that is about to be sent."""
    # Asking for the size first would serialise the message twice.
    payload = message.SerializeToString(deterministic=True)
    if len(payload) > largest_bytes:
        raise _too_large(message.DESCRIPTOR.full_name, len(payload), largest_bytes, code=code)
    return payload


def decode(
    payload: zenoh.ZBytes | bytes | None,
    encoding: zenoh.Encoding | None,
    message_type: type[MessageT],
    *,
    largest_bytes: int,
    code: query_pb2.FaultCode = query_pb2.FAULT_CODE_INVALID_ARGUMENT,
) -> MessageT:
    """Check and parse a received message."""
    # Called thousands of times a second: the texts of an error are made only for the error.
    if encoding != zenoh_encoding_of(message_type):
        received = "none" if encoding is None else str(encoding)
        raise FaultError(code, f"The message has the encoding {received!r}; expected is {encoding_of(message_type)!r}.")
    if payload is not None and len(payload) > largest_bytes:
        raise _too_large(message_type.DESCRIPTOR.full_name, len(payload), largest_bytes, code=code)
    try:
        return message_type.FromString(payload.to_bytes() if isinstance(payload, zenoh.ZBytes) else payload or b"")
    except DecodeError as error:
        name = message_type.DESCRIPTOR.full_name
        raise FaultError(code, f"The payload of {len(payload or b'')} bytes is not a {name}; send one.") from error


def _too_large(name: str, size: int, largest: int, *, code: query_pb2.FaultCode) -> FaultError:
    return FaultError(
        code, f"The {name} has {size} bytes; at most {largest} are allowed (`largest_payload_bytes` of the bus)."
    )
