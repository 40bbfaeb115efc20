"""A part of a run's signals, as it is asked for over the bus: by time and channel, within what one answer may take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from duralab_proto.arrays import to_record
from duralab_proto.v1 import array_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import (
    DAMAGE,
    SUMMARY_METADATA,
    MissingSamplesError,
    RecordingError,
    RunSignals,
    Window,
    index_of,
    is_finished,
    last_metadata,
    messages_of,
    reason_of,
)
from recorder.format import STEP_TOPIC, Summary, files_of
from recorder.refused import RefusedError, invalid

LARGEST_WINDOW_BYTES: Final = 256 * 1024 * 1024
_MOST_SAMPLES: Final = 2.0**53


def read_window(folder: Path, name: str, request: recorder_pb2.SignalWindowRequest) -> recorder_pb2.SignalWindow:
    """Read a part of the signals of one run.

    `folder`: Where the recording's files are; those that are finished are read. `name`: Id of the recording. `request`:
    Run, time within it, channels.
    Returns: With as many samples as the run has in that time.
    Raises `RefusedError`: INVALID_ARGUMENT for a time or a channel that is none, NOT_FOUND without such a run,
    FAILED_PRECONDITION where it may lie in a file that is not finished, DATA_LOSS where blocks are missing within the
    window or a file is damaged.
    """
    _check_time(request)
    try:
        rig, epoch = _last_played(folder, name, request.run)
        channels = _Channels.of(_description(folder, name, rig=rig), request.channels)
        played = {request.run: epoch} if epoch else {}
        signals = RunSignals(_finished_files(folder, name), played=played, rig=rig)
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
        reason = error.reason if isinstance(error, RecordingError) else reason_of(error)
        raise RefusedError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Recording {name!r} is damaged: {reason}; `verify` says more.",
            field="recording",
        ) from error


def _named(folder: Path, name: str) -> str:
    """Return which runs a recording has, in words."""
    told = (last_metadata(path, SUMMARY_METADATA) for path in reversed(_finished_files(folder, name)))
    summary = next((Summary.from_metadata(entries) for entries in told if entries is not None), None)
    return ", ".join(repr(run) for _, run in (summary.runs if summary else ())) or "none"


def _check_time(request: recorder_pb2.SignalWindowRequest) -> None:
    if not (math.isfinite(request.first_second) and request.first_second >= 0.0):
        raise invalid(f"first_second is {request.first_second}; it must be finite and 0 or more.", field="first_second")
    if not (math.isfinite(request.seconds) and request.seconds > 0.0):
        raise invalid(f"seconds is {request.seconds}; it must be finite and greater than 0.", field="seconds")


@dataclass(frozen=True)
class _Channels:
    """The channels that are wanted, and their rows: a slice where it is all of them, which numpy copies faster."""

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
    """Refuse where what is asked for may lie in a file without an end."""
    for path in files_of(folder, name):
        if not is_finished(path):
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {name!r} is not finished: {path.name} has no end, and signals are read from finished "
                f"files; go on with it (`duralab resume {name}`), or end the lab and start it again, which ends the "
                "file where it is whole.",
                field="recording",
            )


def _last_played(folder: Path, name: str, run: str) -> tuple[str, int]:
    """Return on which rig a run was announced, and the epoch that was played to its end: empty and 0 where none is."""
    for path in reversed(_finished_files(folder, name)):
        told = last_metadata(path, SUMMARY_METADATA)
        for (rig, planned), known in ({} if told is None else Summary.from_metadata(told).runs).items():
            if planned == run:
                return rig, 0 if known.played is None else known.played.epoch
    return "", 0


def _description(folder: Path, name: str, *, rig: str) -> rig_pb2.RigDescription:
    topic = STEP_TOPIC + rig_pb2.RigDescription.DESCRIPTOR.name
    for path in _finished_files(folder, name):
        summary = index_of(path)
        wanted = {id for id, channel in summary.channels.items() if channel.topic == topic}
        for chunk in summary.chunk_indexes:
            for id in wanted & chunk.message_index_offsets.keys():
                for message in messages_of(path, chunk, {id}):
                    description = rig_pb2.RigDescription.FromString(message.data)
                    if rig in ("", description.rig):
                        return description
    _refuse_unfinished(folder, name)
    raise RefusedError(
        query_pb2.FAULT_CODE_NOT_FOUND, f"Recording {name!r} holds no description of its rig.", field="recording"
    )


def _window(signals: RunSignals, request: recorder_pb2.SignalWindowRequest) -> tuple[int, Window, float]:
    """Return the first sample of the part of the run that is asked for, the part, and its rate."""
    bound = signals.bound(request.run)
    rate = bound.sample_rate
    if not math.isfinite(request.first_second * rate):
        raise invalid(
            f"first_second is {request.first_second:g}, beyond any sample of {rate:g} Hz; give a time within the run.",
            field="first_second",
        )
    first = math.floor(request.first_second * rate + 0.5)
    # Made whole only when it is bounded: the product may be infinite.
    samples = min(max(request.seconds * rate, 1.0), _MOST_SAMPLES)
    row_bytes = 8 * (bound.drives + bound.responses)
    if min(samples, bound.samples - first) * row_bytes > LARGEST_WINDOW_BYTES:
        most = LARGEST_WINDOW_BYTES // row_bytes / rate
        raise invalid(
            f"seconds is {request.seconds:g}; at most {most:g} s of this run are read at once, of however many of its "
            "channels; ask for one part after the other.",
            field="seconds",
        )
    last = first + math.floor(samples + 0.5)
    # Where it cannot reach the last block, that is not read.
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
