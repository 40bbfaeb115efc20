"""Item of a stream: a message with the epoch of its publisher and its sequence number."""

from __future__ import annotations

import struct
from typing import Final, Generic, NamedTuple, TypeAlias

import zenoh

from duralab_bus.encoding import MessageT, decode
from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2

POSITION: Final = struct.Struct("<QQ")
"""Layout of the attachment of every stream message: epoch and sequence number, unsigned 64 bit, little-endian."""


# A tuple: one is made for every received message.
class StreamItem(NamedTuple, Generic[MessageT]):
    """One message of a stream.

    Parameters
    ----------
    key : str
        Key on which it was published.
    epoch : int
        Epoch of the publisher: a new publisher starts again at sequence number 0.
    seq : int
        Sequence number in the epoch, from 0.
    message : Message
        Parsed message.
    payload : bytes
        Message as published: a receiver that stores it stores these bytes.
    """

    key: str
    epoch: int
    seq: int
    message: MessageT
    payload: bytes = b""

    @property
    def position(self) -> tuple[str, int, int]:
        """Identity of the message among all streams: key, epoch and sequence number."""
        return self.key, self.epoch, self.seq


class RefusedItem(NamedTuple):
    """Received message of a stream that is not as expected: its position like that of a StreamItem, and the fault."""

    key: str
    epoch: int
    seq: int
    fault: FaultError

    @property
    def position(self) -> tuple[str, int, int]:
        """Identity of the message among all streams: key, epoch and sequence number."""
        return self.key, self.epoch, self.seq


Received: TypeAlias = StreamItem[MessageT] | RefusedItem
"""Received item of a stream, accepted or refused."""


def read_item(
    sample: zenoh.Sample, *, key: str, message_type: type[MessageT], largest_bytes: int
) -> Received[MessageT]:
    """Check and parse a stream message, live or replayed."""
    attachment = sample.attachment
    position = b"" if attachment is None else attachment.to_bytes()
    if len(position) != POSITION.size:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"On {key}: The message has {len(position)} bytes of epoch and sequence number attached; expected are "
            f"{POSITION.size}.",
        )
    epoch, seq = POSITION.unpack(position)
    payload = sample.payload.to_bytes()
    try:
        message = decode(payload, sample.encoding, message_type, largest_bytes=largest_bytes)
    except FaultError as fault:
        return RefusedItem(key, epoch, seq, FaultError(fault.code, f"On {key}: {fault.message}"))
    return StreamItem(key, epoch, seq, message, payload)
