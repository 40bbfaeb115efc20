"""The committed steps of a recording, read back: also while it is written, and where its recorder was killed."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final, cast

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.mcap_audit import DAMAGE
from recorder.recording import STEP_TOPIC
from recorder.refused import RefusedError, invalid

LARGEST_ANSWER: Final = 16 * 1024 * 1024
"""Bytes of steps in one answer, unless a single one is larger."""

_MAGIC_BYTES: Final = 8
# Every record begins with its kind and its length.
_RECORD_HEAD: Final = struct.Struct("<BQ")


def read_steps(
    path: Path, request: recorder_pb2.ReadStepsRequest, *, written: int | None
) -> recorder_pb2.RecordedSteps:
    """Read the committed steps of a recording from its file.

    Parameters
    ----------
    path : Path
        The file.
    request : ReadStepsRequest
        The first step wanted.
    written : int or None
        Steps that are known to be in the file: reading ends there, since what follows may be only half there. None
        where its recorder was killed: reading ends with the last whole record.

    Returns
    -------
    RecordedSteps
        As many as fit into 16 MiB, one at least.

    Raises
    ------
    RefusedError
        INVALID_ARGUMENT where there is no such step, DATA_LOSS where the file is damaged.
    """
    answer = recorder_pb2.RecordedSteps()
    room, full = LARGEST_ANSWER, False
    try:
        with path.open("rb") as stream:
            whole = _WholeRecords(stream, end=_end_of_whole_records(stream, path.stat().st_size))
            # It reads as a file does, and nothing else is asked of it.
            reader = StreamReader(cast("IO[bytes]", whole), validate_crcs=True)
            for number, step in enumerate(_steps(reader, most=written)):
                if step.step != number:
                    raise _damaged(path, f"step {number} is missing, though step {step.step} is there")
                answer.total = number + 1
                size = len(step.payload)
                full = full or (bool(answer.steps) and size > room)
                if number >= request.first and not full:
                    answer.steps.append(step)
                    room -= size
    except DAMAGE as error:
        raise _damaged(path, str(error).rstrip(".") or type(error).__name__) from error
    if written is not None and answer.total < written:
        raise _damaged(path, f"it ends after {answer.total} of {written} steps")
    if request.first > answer.total:
        raise invalid(
            f"first is {request.first}; recording {path.stem!r} has {answer.total} steps, from 0.", field="first"
        )
    return answer


def _steps(reader: StreamReader, *, most: int | None) -> Iterator[recorder_pb2.RecordedStep]:
    if most == 0:
        return
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    found = 0
    try:
        for record in reader.records:
            match record:
                case Schema():
                    schemas[record.id] = record.name
                case Channel():
                    channels[record.id] = record
                case Message() if (channel := channels[record.channel_id]).topic.startswith(STEP_TOPIC):
                    yield recorder_pb2.RecordedStep(
                        step=record.sequence, message_type=schemas[channel.schema_id], payload=record.data
                    )
                    found += 1
                    if found == most:
                        return
    except EndOfFile:
        return


class _WholeRecords:
    """A file up to its last whole record: a killed recorder leaves half a one, and all it acknowledged lies before."""

    def __init__(self, stream: IO[bytes], *, end: int) -> None:
        self._stream = stream
        self._left = end

    def read(self, size: int) -> bytes:
        data = self._stream.read(min(size, self._left))
        self._left -= len(data)
        return data


def _end_of_whole_records(stream: IO[bytes], size: int) -> int:
    """Return where the last whole record ends, from the lengths alone, and go back to the start."""
    end = _MAGIC_BYTES
    while end + _RECORD_HEAD.size <= size:
        stream.seek(end)
        opcode, length = _RECORD_HEAD.unpack(stream.read(_RECORD_HEAD.size))
        if opcode == Opcode.FOOTER:
            end = size
        elif end + _RECORD_HEAD.size + length > size:
            break
        else:
            end += _RECORD_HEAD.size + length
    stream.seek(0)
    return end


def _damaged(path: Path, why: str) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_DATA_LOSS,
        f"Recording {path.stem!r} is damaged: {why}; `verify` says more.",
        field="recording",
    )
