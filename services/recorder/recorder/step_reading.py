"""The committed steps of a recording, read back: also while it is written, and where its recorder was killed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from mcap.reader import SeekingReader
from mcap.records import Channel, McapRecord, Message, Schema

from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.mcap_damage import DAMAGE
from recorder.mcap_ending import is_finished, scan
from recorder.recording_content import STEP_TOPIC
from recorder.refused import RefusedError, invalid

LARGEST_ANSWER: Final = 16 * 1024 * 1024
"""Bytes of steps in one answer, unless a single one is larger."""


def read_steps(
    files: Sequence[Path], request: recorder_pb2.ReadStepsRequest, *, written: int | None
) -> recorder_pb2.RecordedSteps:
    """Read the committed steps of a recording from its files.

    Parameters
    ----------
    files : sequence of Path
        The recording's files in their order.
    request : ReadStepsRequest
        The first step wanted.
    written : int or None
        Steps that are known to be in the files: reading ends there, since what follows may be only half there. None
        where its recorder was killed: reading ends with the last whole record.

    Returns
    -------
    RecordedSteps
        As many as fit into 16 MiB, one at least.

    Raises
    ------
    RefusedError
        INVALID_ARGUMENT where there is no such step, DATA_LOSS where a file is damaged.
    """
    answer = recorder_pb2.RecordedSteps()
    name = files[0].stem
    room, full = LARGEST_ANSWER, False
    try:
        for number, step in enumerate(_steps(files)):
            if number == written:
                break
            if step.step != number:
                raise _damaged(name, f"step {number} is missing, though step {step.step} is there")
            answer.total = number + 1
            size = len(step.payload)
            full = full or (bool(answer.steps) and size > room)
            if number >= request.first and not full:
                answer.steps.append(step)
                room -= size
    except DAMAGE as error:
        raise _damaged(name, str(error).rstrip(".") or type(error).__name__) from error
    if written is not None and answer.total < written:
        raise _damaged(name, f"it ends after {answer.total} of {written} steps")
    if request.first > answer.total:
        raise invalid(f"first is {request.first}; recording {name!r} has {answer.total} steps, from 0.", field="first")
    return answer


def _steps(files: Sequence[Path]) -> Iterator[recorder_pb2.RecordedStep]:
    for path in files:
        yield from _indexed(path) if is_finished(path) else _scanned(path)


def _indexed(path: Path) -> Iterator[recorder_pb2.RecordedStep]:
    with path.open("rb") as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
        channels = {} if summary is None else summary.channels
        topics = [channel.topic for channel in channels.values() if channel.topic.startswith(STEP_TOPIC)]
        if not topics:
            return
        for schema, _, message in reader.iter_messages(topics=topics, log_time_order=False):
            yield _step(message, "" if schema is None else schema.name)


def _scanned(path: Path) -> list[recorder_pb2.RecordedStep]:
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    found: list[recorder_pb2.RecordedStep] = []

    def take(record: McapRecord) -> None:
        match record:
            case Schema():
                schemas[record.id] = record.name
            case Channel():
                channels[record.id] = record
            case Message() if (channel := channels[record.channel_id]).topic.startswith(STEP_TOPIC):
                found.append(_step(record, schemas[channel.schema_id]))

    scan(path, take)
    return found


def _step(message: Message, schema: str) -> recorder_pb2.RecordedStep:
    return recorder_pb2.RecordedStep(step=message.sequence, message_type=schema, payload=message.data)


def _damaged(name: str, why: str) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_DATA_LOSS,
        f"Recording {name!r} is damaged: {why}; `verify` says more.",
        field="recording",
    )
