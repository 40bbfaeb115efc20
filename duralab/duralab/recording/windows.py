"""Windows of the signals of a run, read through the index of a recording's files: no more of them than the window."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk

from duralab.errors import InputError
from duralab.recording.damage import DAMAGE, damaged, unreadable
from duralab.recording.epochs import counting_epoch
from duralab.recording.mcap_file import epoch_of
from duralab.recording.mcap_index import require_chunks
from duralab.recording.window_cache import Window, WindowCache
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2

_RECORD_HEAD: Final = struct.Struct("<BQ")
# Of a message index: its channel, and the bytes of its entries, 16 each.
_INDEX_HEAD: Final = struct.Struct("<BQHI")
_ENTRY_BYTES: Final = 16


@dataclass(frozen=True)
class _Place:
    """A chunk that holds `count` blocks of one channel of its file."""

    path: Path
    chunk: ChunkIndex
    channel: int
    count: int


class SignalWindows:
    """Reads parts of runs out of finished files.

    Parameters
    ----------
    files : sequence of Path
        The files of one recording, in order.
    played : mapping of str to int
        The epoch in which each run was played to its end.
    """

    def __init__(self, files: Sequence[Path], *, played: Mapping[str, int]) -> None:
        self._files = list(files)
        self._played = played
        self._cache = WindowCache()
        self._sizes: dict[str, tuple[int, float]] = {}

    @cached_property
    def _places(self) -> dict[str, list[_Place]]:
        """Where the blocks of each run are: those of the epoch that counts, for a repeated run has several."""
        found: dict[str, list[tuple[int, _Place]]] = {}
        for path in self._files:
            try:
                with path.open("rb") as stream:
                    for run, epoch, place in _places_in(path, stream):
                        found.setdefault(run, []).append((epoch, place))
            except OSError as error:
                raise unreadable(path, error) from error
            except DAMAGE as error:
                raise damaged(path, error) from error
        counting = {
            run: counting_epoch([epoch for epoch, _ in places], played=self._played.get(run, 0))
            for run, places in found.items()
        }
        chosen = {run: [place for of, place in places if of == counting[run]] for run, places in found.items()}
        return {run: places for run, places in chosen.items() if places}

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs that have signals, in the order they were recorded."""
        return tuple(self._places)

    def size(self, run: str) -> tuple[int, float]:
        """Return how many samples of a run there are, and their rate in hertz.

        Raises
        ------
        InputError
            There are no signals of such a run.
        """
        if run not in self._sizes:
            end = _end(self._places_of(run))
            self._sizes[run] = (end.first_sample + end.response.shape[-1], end.sample_rate)
        return self._sizes[run]

    def read(self, run: str, first: int, last: int) -> Window:
        """Read the samples from `first` to the one before `last` of a run; the arrays are read-only and kept.

        Raises
        ------
        InputError
            There are no signals of such a run, samples are missing, or a file is damaged or not there any more.
        """
        key = (run, first, last)
        window = self._cache.find(key)
        if window is None:
            window = self._window(run, first, last)
            self._cache.keep(key, window)
        return window

    def _places_of(self, run: str) -> list[_Place]:
        if run not in self._places:
            raise InputError(
                f"{self._files[0]} holds no signals of a run {run!r}; it holds {', '.join(self.runs) or 'none'}."
            )
        return self._places[run]

    def _window(self, run: str, first: int, last: int) -> Window:
        places = self._places_of(run)
        opening = _read(places[0])[0]
        if last <= first:
            return Window(np.zeros((opening.drive.shape[0], 0)), np.zeros((opening.response.shape[0], 0)))
        # Blocks lie in their order unless one was lost on the way and fetched later: then every chunk is looked at.
        blocks = _covering(_likely(places, opening.response.shape[-1], first, last), first, last)
        if _gap(blocks, first, last) is not None:
            blocks = _covering(places, first, last)
            gap = _gap(blocks, first, last)
            if gap is not None:
                raise InputError(
                    f"{self._files[0]} lacks the samples {gap[0]} to {gap[1] - 1} of the run {run!r}; `verify` of the "
                    "recorder says where."
                )
        # Cut before they are joined: the window is kept, and as a view it would hold all of its blocks.
        parts = [slice(max(0, first - block.first_sample), last - block.first_sample) for block in blocks]
        drive, response = (
            np.concatenate(
                [
                    from_array(getattr(block, name), field=name)[:, part]
                    for block, part in zip(blocks, parts, strict=True)
                ],
                axis=1,
            )
            for name in ("drive", "response")
        )
        return Window(drive, response)


def _places_in(path: Path, stream: IO[bytes]) -> Iterator[tuple[str, int, _Place]]:
    summary = SeekingReader(stream).get_summary()
    if summary is None:
        return
    name = rig_pb2.SignalBlock.DESCRIPTOR.full_name
    schemas = {schema.id for schema in summary.schemas.values() if schema.name == name}
    channels = {channel.id: channel for channel in summary.channels.values() if channel.schema_id in schemas}
    for chunk in summary.chunk_indexes:
        for number in sorted(channels.keys() & chunk.message_index_offsets.keys()):
            offset = chunk.message_index_offsets[number]
            stream.seek(offset)
            kind, length, found, entries = _INDEX_HEAD.unpack(stream.read(_INDEX_HEAD.size))
            if (kind, length, found) != (Opcode.MESSAGE_INDEX, _INDEX_HEAD.size - _RECORD_HEAD.size + entries, number):
                raise McapError(f"at byte {offset} is not the message index of channel {number} that its index names")
            channel = channels[number]
            yield (
                channel.topic.rsplit("/", 1)[-1],
                epoch_of(channel),
                _Place(path, chunk, number, entries // _ENTRY_BYTES),
            )


def _likely(places: list[_Place], size: int, first: int, last: int) -> list[_Place]:
    """Return the chunks that hold a window where all blocks but the last are of one size and in order."""
    chosen: list[_Place] = []
    before = 0
    for place in places:
        if before * size < last and (before + place.count) * size > first:
            chosen.append(place)
        before += place.count
    return chosen


def _read(place: _Place) -> list[rig_pb2.SignalBlock]:
    try:
        with place.path.open("rb") as stream:
            require_chunks(stream, [place.chunk])
            stream.seek(place.chunk.chunk_start_offset + _RECORD_HEAD.size)
            records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
        return [
            rig_pb2.SignalBlock.FromString(record.data)
            for record in records
            if isinstance(record, McapMessage) and record.channel_id == place.channel
        ]
    except OSError as error:
        raise unreadable(place.path, error) from error
    except DAMAGE as error:
        raise damaged(place.path, error) from error


def _end(places: list[_Place]) -> rig_pb2.SignalBlock:
    """Return the last block of a run; of one that was broken off, the last one there is."""
    found: list[rig_pb2.SignalBlock] = []
    # It is in the last chunk, unless another block was lost on the way and fetched later.
    for place in reversed(places):
        found += _read(place)
        if any(block.last for block in found):
            break
    return max(found, key=lambda block: block.first_sample)


def _covering(places: list[_Place], first: int, last: int) -> list[rig_pb2.SignalBlock]:
    """Return the blocks that have samples of a window, by their first sample, each once."""
    found = {
        block.first_sample: block
        for place in places
        for block in _read(place)
        if block.first_sample < last and block.first_sample + block.response.shape[-1] > first
    }
    return [found[sample] for sample in sorted(found)]


def _gap(blocks: list[rig_pb2.SignalBlock], first: int, last: int) -> tuple[int, int] | None:
    """Return the first samples of a window that no block has."""
    reached = first
    for block in blocks:
        if block.first_sample > reached:
            return reached, block.first_sample
        reached = block.first_sample + block.response.shape[-1]
    return (reached, last) if reached < last else None
