"""The committed steps of a recording, read back: also while it is written, and where its recorder was killed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mcap.records import ChunkIndex, Message

from duralab_proto.arrays import to_array
from duralab_proto.v1 import query_pb2, recorder_pb2
from duralab_recordings import (
    DAMAGE,
    RecordingError,
    RunSignals,
    check_samples,
    count_messages,
    index_of,
    messages_of,
    reason_of,
)
from recorder.format import STEP_TOPIC, STEP_TYPES, leaves_samples_out
from recorder.refused import RefusedError, invalid

LARGEST_ANSWER: Final = 16 * 1024 * 1024
"""Bytes of steps in one answer, unless a single one is larger."""


def read_steps(
    files: Sequence[Path], request: recorder_pb2.ReadStepsRequest, *, written: int | None
) -> recorder_pb2.RecordedSteps:
    """Read the committed steps of a recording from its files.

    `files`: The recording's files in their order. `request`: The first step wanted. `written`: Steps that are known to
    be in the files: reading ends there, since what follows may be only half there. None where its recorder was killed:
    reading ends with the last whole record.
    Returns: As many as fit into 16 MiB, one at least.
    Raises `RefusedError`: INVALID_ARGUMENT where there is no such step, DATA_LOSS where a file is damaged.
    """
    name = files[0].stem
    try:
        places = list(_places(files))
        there = sum(place.count for place in places)
        if written is not None and there < written:
            raise _damaged(name, f"it ends after {there} of {written} steps")
        answer = recorder_pb2.RecordedSteps(total=there if written is None else written)
        if request.first > answer.total:
            raise invalid(
                f"first is {request.first}; recording {name!r} has {answer.total} steps, from 0.", field="first"
            )
        room = LARGEST_ANSWER
        for number, step in _steps(places, first=request.first):
            if step.step != number:
                raise _damaged(name, f"step {number} is missing, though step {step.step} is there")
            if number == answer.total:
                break
            if request.with_samples:
                _add_samples(step, files)
            size = len(step.payload) + len(step.drive.data) + len(step.response.data)
            if answer.steps and size > room:
                break
            answer.steps.append(step)
            room -= size
    except DAMAGE as error:
        raise _damaged(name, reason_of(error)) from error
    except RecordingError as error:
        raise _damaged(name, error.reason) from error
    return answer


@dataclass(frozen=True)
class _Place:
    """A chunk that holds `count` steps: where, and the full name of the message on each of its channels of steps."""

    path: Path
    chunk: ChunkIndex
    types: dict[int, str]
    count: int


def _places(files: Sequence[Path]) -> Iterator[_Place]:
    for path in files:
        summary = index_of(path)
        types = {
            channel.id: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
            if channel.topic.startswith(STEP_TOPIC)
        }
        with path.open("rb") as stream:
            for chunk in summary.chunk_indexes:
                here = {id: types[id] for id in chunk.message_index_offsets if id in types}
                yield _Place(path, chunk, here, sum(count_messages(stream, chunk, id) for id in here))


def _steps(places: Sequence[_Place], *, first: int) -> Iterator[tuple[int, recorder_pb2.RecordedStep]]:
    """Yield the steps from `first` on with the numbers that they must have; no chunk before is read."""
    before = 0
    for place in places:
        if place.count and before + place.count > first:
            for number, message in enumerate(messages_of(place.path, place.chunk, place.types), start=before):
                if number >= first:
                    yield number, _step(message, place.types[message.channel_id])
        before += place.count


def _step(message: Message, schema: str) -> recorder_pb2.RecordedStep:
    return recorder_pb2.RecordedStep(step=message.sequence, message_type=schema, payload=message.data)


def _add_samples(step: recorder_pb2.RecordedStep, files: Sequence[Path]) -> None:
    """Put the samples of a run beside the step that leaves them to its signal blocks, checked against its hash."""
    kind = STEP_TYPES.get(step.message_type)
    message = None if kind is None else kind.FromString(step.payload)
    if message is None or not leaves_samples_out(message):
        return
    window, _ = RunSignals(files, played={message.run: message.signal_epoch}).whole(message.run)
    check_samples(window, message.samples_hash, path=files[0], run=message.run)
    step.drive.CopyFrom(to_array(window.drive))
    step.response.CopyFrom(to_array(window.response))


def _damaged(name: str, why: str) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_DATA_LOSS,
        f"Recording {name!r} is damaged: {why}; `verify` says more.",
        field="recording",
    )
