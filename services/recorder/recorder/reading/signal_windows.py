"""A part of a run's signals, read through the index: nothing else of a file is read than the chunks that count."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from mcap.records import Channel, ChunkIndex

from duralab_proto.arrays import from_array, to_record
from duralab_proto.v1 import array_pb2, query_pb2, recorder_pb2, rig_pb2
from recorder.format import EPOCH, STEP_TOPIC, SUMMARY_METADATA, Summary, files_of
from recorder.mcap import DAMAGE, count_messages, index_of, is_finished, last_metadata, messages_of, reason_of
from recorder.refused import RefusedError, invalid

LARGEST_WINDOW_BYTES: Final = 256 * 1024 * 1024
_MOST_SAMPLES: Final = 2.0**53


@dataclass(frozen=True)
class _Place:
    """A chunk with blocks of the run: where, and how many."""

    path: Path
    chunk: ChunkIndex
    channel: int
    count: int


def read_window(folder: Path, name: str, request: recorder_pb2.SignalWindowRequest) -> recorder_pb2.SignalWindow:
    """Read a part of the signals of one run.

    Parameters
    ----------
    folder : Path
        Where the recording's files are; those that are finished are read.
    name : str
        Id of the recording.
    request : SignalWindowRequest
        Run, time within it, channels.

    Returns
    -------
    recorder_pb2.SignalWindow
        With as many samples as the run has in that time.

    Raises
    ------
    RefusedError
        INVALID_ARGUMENT for a time or a channel that is none, NOT_FOUND without such a run, FAILED_PRECONDITION where
        it may lie in a file that is not finished, DATA_LOSS where blocks are
        missing within the window or a file is damaged.
    """
    _check_time(request)
    try:
        rig, epoch = _last_played(folder, name, request.run)
        channels = _Channels.of(_description(folder, name, rig=rig), request.channels)
        places = _of_epoch(list(_places(folder, name, request.run, rig=rig)), epoch)
        if not places:
            _refuse_unfinished(folder, name)
            raise RefusedError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"Recording {name!r} holds no finished signals of a run {request.run!r}; it has "
                f"{_named(folder, name)}.",
                field="run",
            )
        blocks, first, last = _blocks(places, request)
        return _joined(request.run, blocks, first=first, last=last, channels=channels)
    except DAMAGE as error:
        raise RefusedError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Recording {name!r} is damaged: {reason_of(error)}; `verify` says more.",
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


def _places(folder: Path, name: str, run: str, *, rig: str) -> Iterator[tuple[int, _Place]]:
    """Yield epoch and place of every chunk that holds blocks of the run, in the order they were written."""
    for path in _finished_files(folder, name):
        summary = index_of(path)
        wanted = {id: channel for id, channel in summary.channels.items() if _is_of_run(channel, run, rig=rig)}
        if not wanted:
            continue
        with path.open("rb") as stream:
            for chunk in summary.chunk_indexes:
                for id in wanted.keys() & chunk.message_index_offsets.keys():
                    count = count_messages(stream, chunk, id)
                    yield int(wanted[id].metadata[EPOCH]), _Place(path, chunk, id, count)


def _is_of_run(channel: Channel, run: str, *, rig: str) -> bool:
    of_rig = f"/{rig}" if rig else ""
    return channel.topic.endswith(f"{of_rig}/signal/{run}") and EPOCH in channel.metadata


def _of_epoch(places: list[tuple[int, _Place]], epoch: int) -> list[_Place]:
    """Return the places of the epoch that was played to its end, or where none was of the one written last.

    A run that was repeated after a fault has several, and their numbers do not tell: a clock may have been set back.
    """
    wanted = epoch or (places[-1][0] if places else 0)
    return [place for of, place in places if of == wanted]


def _blocks(
    places: list[_Place], request: recorder_pb2.SignalWindowRequest
) -> tuple[list[rig_pb2.SignalBlock], int, int]:
    """Return the blocks that cover the window, and its first sample and the one after its last."""
    begin = min(_read(places[0]), key=lambda block: block.first_sample)
    rate, size = begin.sample_rate, begin.response.shape[-1]
    if not math.isfinite(request.first_second * rate):
        raise invalid(
            f"first_second is {request.first_second:g}, beyond any sample of {rate:g} Hz; give a time within the run.",
            field="first_second",
        )
    first = math.floor(request.first_second * rate + 0.5)
    # Made whole only when it is bounded: the product may be infinite.
    samples = min(max(request.seconds * rate, 1.0), _MOST_SAMPLES)
    row_bytes = 8 * (begin.drive.shape[0] + begin.response.shape[0])
    played = sum(place.count for place in places) * size
    if min(samples, played - first) * row_bytes > LARGEST_WINDOW_BYTES:
        most = LARGEST_WINDOW_BYTES // row_bytes / rate
        raise invalid(
            f"seconds is {request.seconds:g}; at most {most:g} s of this run are read at once, of however many of its "
            "channels; ask for one part after the other.",
            field="seconds",
        )
    last = first + math.floor(samples + 0.5)
    # Blocks lie in their order unless one was lost on the way and fetched later: then every chunk is looked at.
    likely: list[_Place] = []
    before = 0
    for place in places:
        if before * size < last and (before + place.count) * size > first:
            likely.append(place)
        before += place.count
    blocks = _covering(likely, first, last)
    if not _covers(blocks, first, last):
        blocks = _covering(places, first, last)
        if not _covers(blocks, first, last):
            end = max(block.first_sample + block.response.shape[-1] for place in places for block in _read(place))
            if first >= end:
                raise invalid(
                    f"first_second is {request.first_second:g}; run {request.run!r} ends at {end / rate:g} s.",
                    field="first_second",
                )
            raise RefusedError(
                query_pb2.FAULT_CODE_DATA_LOSS,
                f"Run {request.run!r}, here up to {end / rate:g} s, has no whole signals from {request.first_second:g} "
                f"s on for {request.seconds:g} s: it was broken off, or blocks are missing; `verify` says more.",
                field="first_second",
            )
    return blocks, first, min(last, blocks[-1].first_sample + blocks[-1].response.shape[-1])


def _covering(places: list[_Place], first: int, last: int) -> list[rig_pb2.SignalBlock]:
    found = {
        block.first_sample: block
        for place in places
        for block in _read(place)
        if block.first_sample < last and block.first_sample + block.response.shape[-1] > first
    }
    return [found[sample] for sample in sorted(found)]


def _covers(blocks: list[rig_pb2.SignalBlock], first: int, last: int) -> bool:
    if not blocks or blocks[0].first_sample > first:
        return False
    ends = [block.first_sample + block.response.shape[-1] for block in blocks]
    contiguous = all(end == block.first_sample for end, block in zip(ends, blocks[1:], strict=False))
    return contiguous and (ends[-1] >= last or blocks[-1].last)


def _read(place: _Place) -> list[rig_pb2.SignalBlock]:
    messages = messages_of(place.path, place.chunk, {place.channel})
    return [rig_pb2.SignalBlock.FromString(message.data) for message in messages]


def _joined(
    run: str, blocks: list[rig_pb2.SignalBlock], *, first: int, last: int, channels: _Channels
) -> recorder_pb2.SignalWindow:
    drive, response = (np.empty((len(of), last - first)) for of in (channels.drives, channels.responses))
    for block in blocks:
        begin = block.first_sample
        inside = slice(max(first - begin, 0), last - begin)
        place = slice(max(begin - first, 0), begin - first + block.response.shape[-1])
        drive[:, place] = from_array(block.drive, field="drive")[:, inside][channels.drive_rows]
        response[:, place] = from_array(block.response, field="response")[:, inside][channels.response_rows]
    rate = blocks[0].sample_rate
    window = recorder_pb2.SignalWindow(run=run, first_sample=first)
    to_record(channels.drives, rate, drive, into=window.drive)
    to_record(channels.responses, rate, response, into=window.response)
    return window
