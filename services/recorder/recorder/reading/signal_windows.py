"""Steps and signals of a recording, read within the size limit of one answer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from mcap.records import ChunkIndex

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import (
    DAMAGE,
    SUMMARY_METADATA,
    MissingSamplesError,
    RecordingError,
    RunSignals,
    Window,
    check_samples,
    count_messages,
    index_of,
    is_finished,
    last_metadata,
    messages_of,
    messages_on,
    reason_of,
)
from recorder.format import STEP_TOPIC, STEP_TYPES, Runs, Summary, files_of, leaves_samples_out
from recorder.refused import RefusedError, invalid

LARGEST_WINDOW_BYTES: Final = 256 * 1024 * 1024
_MOST_SAMPLES: Final = 2.0**53


def read_window(folder: Path, name: str, request: recorder_pb2.SignalWindowRequest) -> recorder_pb2.SignalWindow:
    """Read a part of the signals of one run from the finished files of a recording.

    INVALID_ARGUMENT if a time or a channel is not valid, NOT_FOUND if there is no such run, FAILED_PRECONDITION if
    the run may be in an unfinished file, DATA_LOSS if blocks are missing or a file is damaged.
    """
    _check_time(request)
    try:
        rig, epoch = _last_played(folder, name, request.run)
        channels = _Channels.of(_description(folder, name, rig=rig), request.channels)
        played = {request.run: epoch} if epoch else {}
        signals = RunSignals(_finished_files(folder, name), played=played, rig=rig, run=request.run)
        if request.run not in signals.runs:
            _refuse_unfinished(folder, name)
            raise RefusedError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"Recording {name!r} holds no finished signals of a run {request.run!r}; it has "
                f"{_named(folder, name)}.",
                field="run",
            )
        first, window, rate = _window(signals, request)
        return _answer(request.run, window, first=first, rate=rate, channels=channels)
    except (*DAMAGE, RecordingError) as error:
        raise _damaged(name, reason_of(error)) from error


def _named(folder: Path, name: str) -> str:
    """Return the names of a recording's runs as text."""
    candidates = (_runs(path) for path in reversed(_finished_files(folder, name)))
    runs = next((found for found in candidates if found is not None), {})
    return ", ".join(repr(run) for _, run in runs) or "none"


def _runs(path: Path) -> Runs | None:
    """Return the runs in the summary of a file; None if it has no summary. Cached until the file changes."""
    status = path.stat()
    return _runs_of(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=16)
def _runs_of(path: Path, size: int, changed: int) -> Runs | None:
    del size, changed  # Only part of the cache's key.
    metadata = last_metadata(path, SUMMARY_METADATA)
    return None if metadata is None else Summary.from_metadata(metadata).runs


def _check_time(request: recorder_pb2.SignalWindowRequest) -> None:
    if not (math.isfinite(request.first_second) and request.first_second >= 0.0):
        raise invalid(f"first_second is {request.first_second}; it must be finite and 0 or more.", field="first_second")
    if not (math.isfinite(request.seconds) and request.seconds > 0.0):
        raise invalid(f"seconds is {request.seconds}; it must be finite and greater than 0.", field="seconds")


@dataclass(frozen=True)
class _Channels:
    """The requested channels, and their rows: a slice for all of them, which numpy copies faster."""

    drives: list[array_pb2.Channel]
    drive_rows: list[int] | slice
    responses: list[array_pb2.Channel]
    response_rows: list[int] | slice

    @staticmethod
    def of(description: rig_pb2.RigDescription, names: Sequence[str]) -> _Channels:
        known = list(dict.fromkeys(channel.name for channel in (*description.drives, *description.responses)))
        if unknown := [name for name in names if name not in known]:
            raise invalid(f"The rig has no channel {unknown[0]!r}; it has {', '.join(known)}.", field="channels")
        drive_rows, response_rows = (
            [row for row, channel in enumerate(of) if not names or channel.name in names]
            for of in (description.drives, description.responses)
        )
        return _Channels(
            [description.drives[row] for row in drive_rows],
            drive_rows if names else slice(None),
            [description.responses[row] for row in response_rows],
            response_rows if names else slice(None),
        )


def _finished_files(folder: Path, name: str) -> list[Path]:
    return [path for path in files_of(folder, name) if is_finished(path)]


def _refuse_unfinished(folder: Path, name: str) -> None:
    """Refuse a request whose data may be in a file without an end."""
    for path in files_of(folder, name):
        if not is_finished(path):
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {name!r} is not finished: {path.name} has no end, and signals are read from finished "
                f"files; continue it (`duralab resume {name}`), or end the lab and start it again, which ends the "
                "file where it is whole.",
                field="recording",
            )


def _last_played(folder: Path, name: str, run: str) -> tuple[str, int]:
    """Return the rig of a run and the epoch played to its end; empty if there is no such run, 0 if none ended."""
    for path in reversed(_finished_files(folder, name)):
        for (rig, planned), known in (_runs(path) or {}).items():
            if planned == run:
                return rig, 0 if known.played is None else known.played.epoch
    return "", 0


def _description(folder: Path, name: str, *, rig: str) -> rig_pb2.RigDescription:
    topic = STEP_TOPIC + rig_pb2.RigDescription.DESCRIPTOR.name
    for path in _finished_files(folder, name):
        for message in messages_on(path, topic):
            description = rig_pb2.RigDescription.FromString(message.data)
            if rig in ("", description.rig):
                return description
    _refuse_unfinished(folder, name)
    raise RefusedError(
        query_pb2.FAULT_CODE_NOT_FOUND, f"Recording {name!r} holds no description of its rig.", field="recording"
    )


def _window(signals: RunSignals, request: recorder_pb2.SignalWindowRequest) -> tuple[int, Window, float]:
    """Return the first sample of the requested part of the run, the part, and its sample rate."""
    bound = signals.bound(request.run)
    rate = bound.sample_rate
    if not math.isfinite(request.first_second * rate):
        raise invalid(
            f"first_second is {request.first_second:g}, beyond any sample of {rate:g} Hz; give a time within the run.",
            field="first_second",
        )
    first = math.floor(request.first_second * rate + 0.5)
    # Converted to an integer after it is bounded: the product may be infinite.
    samples = min(max(request.seconds * rate, 1.0), _MOST_SAMPLES)
    row_bytes = 8 * (bound.drives + bound.responses)
    if min(samples, bound.samples - first) * row_bytes > LARGEST_WINDOW_BYTES:
        most = LARGEST_WINDOW_BYTES // row_bytes / rate
        raise invalid(
            f"seconds is {request.seconds:g}; at most {most:g} s of this run are read at once, for any number of its "
            "channels; ask for one part after the other.",
            field="seconds",
        )
    last = first + math.floor(samples + 0.5)
    # The last block is read only if the window may reach it.
    if last > bound.samples - bound.block_samples:
        end, _, ended = signals.end(request.run)
        if first >= end:
            raise _beyond(request, end / rate)
        if last > end and not ended:
            raise _lacking(request, end / rate)
        last = min(last, end)
    try:
        return first, signals.read(request.run, first, last), rate
    except MissingSamplesError:
        end, _, _ = signals.end(request.run)
        raise (_beyond if first >= end else _lacking)(request, end / rate) from None


def _beyond(request: recorder_pb2.SignalWindowRequest, end_seconds: float) -> RefusedError:
    return invalid(
        f"first_second is {request.first_second:g}; run {request.run!r} ends at {end_seconds:g} s.",
        field="first_second",
    )


def _lacking(request: recorder_pb2.SignalWindowRequest, end_seconds: float) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_DATA_LOSS,
        f"Run {request.run!r}, here up to {end_seconds:g} s, has no whole signals from {request.first_second:g} s on "
        f"for {request.seconds:g} s: it was broken off, or blocks are missing; `verify` says more.",
        field="first_second",
    )


def _answer(run: str, window: Window, *, first: int, rate: float, channels: _Channels) -> recorder_pb2.SignalWindow:
    answer = recorder_pb2.SignalWindow(run=run, first_sample=first)
    to_record(channels.drives, rate, window.drive[channels.drive_rows], into=answer.drive)
    to_record(channels.responses, rate, window.response[channels.response_rows], into=answer.response)
    return answer


LARGEST_ANSWER: Final = 16 * 1024 * 1024
"""Largest number of bytes of steps in one answer, unless a single step is larger."""


def read_steps(
    files: Sequence[Path], request: recorder_pb2.ReadStepsRequest, *, written: int | None
) -> recorder_pb2.RecordedSteps:
    """Read the committed steps of a recording: as many as fit into 16 MiB, at least one.

    `written`: Number of steps that are known to be in the files; later data may be incomplete. None if the recorder
    was killed: reading ends with the last complete record.
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
    except (*DAMAGE, RecordingError) as error:
        raise _damaged(name, reason_of(error)) from error
    return answer


@dataclass(frozen=True)
class _Place:
    """A chunk with `count` steps, and the full name of the message on each of its channels of steps."""

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
    """Yield the steps from `first` on with their expected numbers; earlier chunks are not read."""
    before = 0
    for place in places:
        if place.count and before + place.count > first:
            for number, message in enumerate(messages_of(place.path, place.chunk, place.types), start=before):
                if number >= first:
                    kind = place.types[message.channel_id]
                    step = recorder_pb2.RecordedStep(step=message.sequence, message_type=kind, payload=message.data)
                    yield number, step
        before += place.count


def _add_samples(step: recorder_pb2.RecordedStep, files: Sequence[Path]) -> None:
    """Add the samples of a run to the step that leaves them to its signal blocks, checked against its hash."""
    kind = STEP_TYPES.get(step.message_type)
    message = None if kind is None else kind.FromString(step.payload)
    if message is None or not leaves_samples_out(message):
        return
    played = {message.run: message.signal_epoch}
    window, _ = RunSignals(files, played=played, run=message.run).whole(message.run)
    check_samples(window, message.samples_hash, path=files[0], run=message.run)
    step.drive.CopyFrom(to_array(window.drive))
    step.response.CopyFrom(to_array(window.response))


def _damaged(name: str, why: str) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_DATA_LOSS,
        f"Recording {name!r} is damaged: {why}; `verify` says more.",
        field="recording",
    )
