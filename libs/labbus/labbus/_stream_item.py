"""What a stream carries: a message with the epoch of its publisher and its sequence number."""

from __future__ import annotations

import struct
from typing import Final, Generic, NamedTuple

import zenoh

from duralab_proto.v1 import query_pb2
from labbus._encoding import MessageT, decode
from labbus._faults import FaultError

POSITION: Final = struct.Struct("<QQ")
"""The attachment of every stream message: epoch and sequence number, unsigned 64 bit, little-endian."""


# A tuple: one is made for every message that comes.
class StreamItem(NamedTuple, Generic[MessageT]):
    """One message of a stream.

    Parameters
    ----------
    key : str
        It was published on.
    epoch : int
        Of the publisher: a new one starts again at sequence number 0.
    seq : int
        Sequence number in the epoch, from 0.
    message : Message
        Parsed.
    payload : bytes
        The message as it was published: who stores it stores these bytes.
    """

    key: str
    epoch: int
    seq: int
    message: MessageT
    payload: bytes = b""

    @property
    def position(self) -> tuple[str, int, int]:
        """Which message it is, of all streams: key, epoch and sequence number."""
        return self.key, self.epoch, self.seq


def read_item(
    sample: zenoh.Sample, *, key: str, message_type: type[MessageT], largest_bytes: int
) -> StreamItem[MessageT]:
    """Check and parse a stream message, live or replayed.

    Raises
    ------
    FaultError
        DATA_LOSS without epoch and sequence number, INVALID_ARGUMENT where it is not the message expected.
    """
    try:
        attachment = sample.attachment
        position = b"" if attachment is None else attachment.to_bytes()
        if len(position) != POSITION.size:
            raise FaultError(
                query_pb2.FAULT_CODE_DATA_LOSS,
                f"The message has {len(position)} bytes of epoch and sequence number attached; expected are "
                f"{POSITION.size}.",
            )
        payload = sample.payload.to_bytes()
        message = decode(payload, sample.encoding, message_type, largest_bytes=largest_bytes)
    except FaultError as fault:
        raise FaultError(fault.code, f"On {key}: {fault.message}") from fault
    epoch, seq = POSITION.unpack(position)
    return StreamItem(key, epoch, seq, message, payload)
