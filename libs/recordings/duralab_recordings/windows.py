"""Signals of the runs of a recording, read through the index of its files: only the requested parts."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import Final

import numpy as np
from mcap.exceptions import McapError

from duralab_proto.arrays import ArrayError, SamplesHash, from_array, samples_hash
from duralab_proto.keys import rig_of
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2
from duralab_recordings.damage import MissingSamplesError, RecordingError, reading, within_contract
from duralab_recordings.index import count_messages, index_of, messages_at
from duralab_recordings.mcap_file import epoch_of

CACHE_BYTES: Final = 128 * 1024 * 1024
"""Size in bytes of the newest windows that are kept."""
WINDOW_BYTES: Final = 1024
"""Size in bytes of a window beside its samples, rounded up: for single samples that is nearly all."""


def played_epochs(messages: Iterable[recorder_pb2.RunPlayed]) -> dict[str, int]:
    """Return the epoch in which each run was played to its end, by run.

    Parameters
    ----------
    messages : iterable of RunPlayed
        Messages committed after playbacks, in order: the last of a run counts.

    Returns
    -------
    dict of str to int
        Epochs without the runs that were not played to their end.
    """
    return {played.run: played.epoch for played in messages}


@dataclass(frozen=True)
class BlockPlace:
    """Chunk that holds `count` signal blocks of one channel of its file.

    Parameters
    ----------
    path : Path
        Path of the file.
    offset : int
        Position of the chunk.
    channel : int
        Number of the channel.
    count : int
        Number of blocks.
    """

    path: Path
    offset: int
    channel: int
    count: int


@dataclass(frozen=True)
class RunBound:
    """Upper bound of a run: samples of each channel if all blocks are of one size, channels, rate in hertz."""

    samples: int
    block_samples: int
    drives: int
    responses: int
    sample_rate: float


@dataclass(frozen=True)
class Window:
    """Part of a run.

    Parameters
    ----------
    drive : ndarray, shape (drives, samples)
        Commands, in the rig's units.
    response : ndarray, shape (responses, samples)
        Measurements, in the rig's units.
    """

    drive: np.ndarray
    response: np.ndarray

    @property
    def bytes(self) -> int:
        """Memory in bytes if its arrays are not views of larger ones."""
        return self.drive.nbytes + self.response.nbytes + WINDOW_BYTES


class WindowCache:
    """Most recently used windows of one recording, by run, first sample and the sample after the last."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, int, int], Window] = OrderedDict()
        self._bytes = 0
        # xarray reads from several threads if its user divides an array into pieces.
        self._lock = Lock()

    def find(self, key: tuple[str, int, int]) -> Window | None:
        """Return the window of a run, its first sample and the sample after its last; None if it is not kept."""
        with self._lock:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            return self._kept[key]

    def keep(self, key: tuple[str, int, int], window: Window) -> None:
        """Keep a window with its own arrays, instead of the least recently used one; its arrays become read-only."""
        # A change of a kept window in place would change later reads; read-only arrays make it an error.
        window.drive.setflags(write=False)
        window.response.setflags(write=False)
        with self._lock:
            # Two threads may have read the same window.
            replaced = self._kept.pop(key, None)
            self._kept[key] = window
            self._bytes += window.bytes - (replaced.bytes if replaced is not None else 0)
            while self._bytes > CACHE_BYTES and len(self._kept) > 1:
                _, dropped = self._kept.popitem(last=False)
                self._bytes -= dropped.bytes

    def __reduce__(self) -> tuple[type[WindowCache], tuple[()]]:
        """Copy the cache empty: a dataset for another process carries no windows, they are read there."""
        return WindowCache, ()


class RunSignals:
    """Reader of runs, and of parts of them, from the files of a recording.

    If a run was repeated after a fault, the epoch that was played to its end counts, or without one the last written
    epoch. The epoch numbers do not decide: they come from a clock, which may have been set back.

    Parameters
    ----------
    files : sequence of Path
        Files of one recording, in order.
    played : mapping of str to int
        Epoch in which each run was played to its end.
    rig : str
        Only the runs on this rig; all if empty.
    run : str
        Only this run; all if empty. The positions of the others are not read.
    """

    def __init__(self, files: Sequence[Path], *, played: Mapping[str, int], rig: str = "", run: str = "") -> None:
        self._files = list(files)
        self._played = played
        self._rig = rig
        self._run = run
        self._cache = WindowCache()
        self._bounds: dict[str, RunBound] = {}
        self._ends: dict[str, tuple[int, float, bool]] = {}

    @cached_property
    def _places(self) -> dict[str, list[BlockPlace]]:
        """Positions of the blocks of each run in the order of writing, for the epoch that counts."""
        found: dict[str, list[tuple[int, BlockPlace]]] = {}
        for path in self._files:
            for topic, epoch, place in block_places(path, run=self._run):
                if not self._rig or rig_of(topic) == self._rig:
                    found.setdefault(topic.rsplit("/", 1)[-1], []).append((epoch, place))
        chosen: dict[str, list[BlockPlace]] = {}
        for run, places in found.items():
            counting = self._played.get(run, 0) or places[-1][0]
            if here := [place for epoch, place in places if epoch == counting]:
                chosen[run] = here
        return chosen

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs with signals, in the order of recording."""
        return tuple(self._places)

    def end(self, run: str) -> tuple[int, float, bool]:
        """Return the number of existing samples, the sample rate in hertz, and whether the last block exists."""
        if run not in self._ends:
            end = _end(self._places_of(run))
            self._ends[run] = (end.first_sample + end.response.shape[-1], end.sample_rate, end.last)
        return self._ends[run]

    def size(self, run: str) -> tuple[int, float]:
        """Return the number of existing samples and the sample rate in hertz."""
        samples, rate, _ = self.end(run)
        return samples, rate

    def bound(self, run: str) -> RunBound:
        """Return the upper bound of a run's size, from its first block and the number of its blocks."""
        if run not in self._bounds:
            places = self._places_of(run)
            opening = _read(places[0])[0]
            size, rows = opening.response.shape[-1], (opening.drive.shape[0], opening.response.shape[0])
            self._bounds[run] = RunBound(
                sum(place.count for place in places) * size, size, *rows, sample_rate=opening.sample_rate
            )
        return self._bounds[run]

    def read(self, run: str, first: int, last: int) -> Window:
        """Read the samples from `first` to the one before `last` of a run; they are read-only and kept."""
        key = (run, first, last)
        window = self._cache.find(key)
        if window is None:
            window = self._window(run, first, last)
            self._cache.keep(key, window)
        return window

    def whole(self, run: str, *, finished: bool = True) -> tuple[Window, float]:
        """Read all samples of a run, and its sample rate in hertz; `finished` is for the sentence of an error."""
        reached, rate, ended = self.end(run)
        window = self.read(run, 0, reached)
        if not ended:
            repair = "" if finished else "start the recorder on its folder, which repairs it, then "
            raise MissingSamplesError(
                f"{self._files[0]} holds the run {run!r} up to sample {reached - 1} ({reached / rate:g} s) only and "
                f"not its last block; {repair}read the others with `responses({run!r})` and `drives({run!r})`."
            )
        return window, rate

    def _places_of(self, run: str) -> list[BlockPlace]:
        if run not in self._places:
            raise RecordingError(
                f"{self._files[0]} holds no signals of a run {run!r}; it holds {', '.join(self.runs) or 'none'}."
            )
        return self._places[run]

    def _window(self, run: str, first: int, last: int) -> Window:
        places = self._places_of(run)
        bound = self.bound(run)
        if last <= first:
            return Window(np.zeros((bound.drives, 0)), np.zeros((bound.responses, 0)))
        # Blocks are in order unless one was lost in transit and fetched later: then every chunk is searched.
        blocks = _covering(_likely(places, bound.block_samples, first, last), first, last)
        if _gap(blocks, first, last) is not None:
            blocks = _covering(places, first, last)
            gap = _gap(blocks, first, last)
            if gap is not None:
                raise MissingSamplesError(
                    f"{self._files[0]} lacks the samples {gap[0]} to {gap[1] - 1} of the run {run!r}; `verify` of the "
                    "recorder says where."
                )
        for before, block in pairwise(blocks):
            reached, begins = before.first_sample + before.response.shape[-1], block.first_sample
            if begins < reached:
                raise RecordingError(
                    f"{self._files[0]} holds the samples {begins} to {reached - 1} of the run {run!r} twice."
                )
        # Cut before joining: the window is kept, and a view would hold all of its blocks.
        parts = [slice(max(0, first - block.first_sample), last - block.first_sample) for block in blocks]
        with within_contract(self._files[0]):
            drive, response = (
                np.concatenate(
                    [
                        from_array(getattr(block, name), field=name, shape=(rows, None))[:, part]
                        for block, part in zip(blocks, parts, strict=True)
                    ],
                    axis=1,
                )
                for name, rows in (("drive", bound.drives), ("response", bound.responses))
            )
        return Window(drive, response)


def hash_of_blocks(places: Iterable[BlockPlace]) -> str:
    """Return the hash of the samples of a run, computed from its blocks on disk.

    Parameters
    ----------
    places : iterable of BlockPlace
        All positions of the run, of one epoch, in the order of writing.

    Returns
    -------
    str
        As `duralab_proto.arrays.samples_hash`; empty if the blocks do not follow each other to the last one.

    Raises
    ------
    RecordingError
        If a file is damaged or cannot be read.
    """
    order = _BlockHash()
    for place in places:
        for block in _read(place):
            with within_contract(place.path):
                order.take(block)
    return order.result


class _BlockHash:
    """Hash of the samples of a run from its blocks in any order; a block before its turn is kept."""

    def __init__(self) -> None:
        self._hash = SamplesHash()
        self._reached = 0
        self._waiting: dict[int, rig_pb2.SignalBlock] = {}
        self._whole = False

    def take(self, block: rig_pb2.SignalBlock) -> None:
        """Add a block; raises ArrayError if its arrays are damaged."""
        self._waiting[block.first_sample] = block
        while (following := self._waiting.pop(self._reached, None)) is not None:
            self._hash.add(from_array(following.drive, field="drive"), from_array(following.response, field="response"))
            self._reached += following.response.shape[-1]
            self._whole = self._whole or following.last
            if not following.response.shape[-1]:
                break

    @property
    def result(self) -> str:
        """SHA-256 (hexadecimal) of the samples; empty if some are missing."""
        return self._hash.hexdigest() if self._whole and not self._waiting else ""


def check_samples(window: Window, wanted: str, *, path: Path, run: str) -> None:
    """Check the samples of a run against the hash in its step.

    Parameters
    ----------
    window : Window
        Whole run.
    wanted : str
        Hash in the step.
    path : Path
        First file of the recording, for the sentence.
    run : str
        Name of the run, for the sentence.

    Raises
    ------
    RecordingError
        If the samples differ.
    """
    if samples_hash(window.drive, window.response) != wanted:
        raise RecordingError(
            f"The signal blocks of the run {run!r} in {path} are not the samples that its step was made of; "
            f"`duralab verify {path}` says more."
        )


def block_places(path: Path, *, run: str = "") -> Iterator[tuple[str, int, BlockPlace]]:
    """Yield the positions of signal blocks in a file, chunk after chunk in the order of writing.

    Parameters
    ----------
    path : Path
        Path of the file; a file without an end is read as far as it is intact.
    run : str
        Only the blocks of this run; all if empty.

    Yields
    ------
    str, int, BlockPlace
        Key of the run's signals, epoch of their publisher, and position.

    Raises
    ------
    RecordingError
        If the file is damaged or cannot be read.
    """
    with reading(path):
        summary = index_of(path)
        name = rig_pb2.SignalBlock.DESCRIPTOR.full_name
        schemas = {schema.id for schema in summary.schemas.values() if schema.name == name}
        channels = {
            channel.id: channel
            for channel in summary.channels.values()
            if channel.schema_id in schemas and run in ("", channel.topic.rsplit("/", 1)[-1])
        }
        with path.open("rb") as stream:
            for chunk in summary.chunk_indexes:
                for number in sorted(channels.keys() & chunk.message_index_offsets.keys()):
                    count = count_messages(stream, chunk, number)
                    place = BlockPlace(path, chunk.chunk_start_offset, number, count)
                    yield channels[number].topic, epoch_of(channels[number]), place


def _likely(places: list[BlockPlace], size: int, first: int, last: int) -> list[BlockPlace]:
    """Return the chunks that hold a window if all blocks but the last are of one size and in order."""
    chosen: list[BlockPlace] = []
    before = 0
    for place in places:
        if before * size < last and (before + place.count) * size > first:
            chosen.append(place)
        before += place.count
    return chosen


def _read(place: BlockPlace) -> list[rig_pb2.SignalBlock]:
    with reading(place.path), place.path.open("rb") as stream:
        messages = messages_at(stream, place.offset, {place.channel})
        if len(messages) != place.count:
            raise McapError(f"the chunk at byte {place.offset} holds {len(messages)} blocks, its index {place.count}")
        return [rig_pb2.SignalBlock.FromString(message.data) for message in messages]


def _end(places: Collection[BlockPlace]) -> rig_pb2.SignalBlock:
    """Return the last block of a run; for an aborted run, the last existing one."""
    found: list[rig_pb2.SignalBlock] = []
    # It is in the last chunk, unless another block was lost in transit and fetched later.
    for place in reversed(list(places)):
        found += _read(place)
        if any(block.last for block in found):
            break
    return max(found, key=lambda block: block.first_sample)


def _covering(places: list[BlockPlace], first: int, last: int) -> list[rig_pb2.SignalBlock]:
    """Return the blocks with samples of a window, by their first sample, each once."""
    found = {
        block.first_sample: block
        for place in places
        for block in _read(place)
        if block.first_sample < last and block.first_sample + block.response.shape[-1] > first
    }
    return [found[sample] for sample in sorted(found)]


def _gap(blocks: list[rig_pb2.SignalBlock], first: int, last: int) -> tuple[int, int] | None:
    """Return the first range of a window that no block holds, or None."""
    reached = first
    for block in blocks:
        if block.first_sample > reached:
            return reached, block.first_sample
        reached = block.first_sample + block.response.shape[-1]
    return (reached, last) if reached < last else None


def target_of(
    step: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep, targets: Sequence[np.ndarray]
) -> np.ndarray:
    """Return the target against which a playback was judged.

    Parameters
    ----------
    step : IterationStep or ConfirmationStep
        Step of the playback.
    targets : sequence of ndarray, shape (responses, samples)
        Targets of the recording, one for each control band, in order.

    Returns
    -------
    ndarray, shape (responses, samples)
        Target of the playback.

    Raises
    ------
    ArrayError
        If the step names a target that the recording does not hold.
    """
    if step.judged_target >= len(targets):
        raise ArrayError(
            f"judged_target is {step.judged_target} and the recording holds {len(targets)} targets",
            field="judged_target",
        )
    return targets[step.judged_target]


def response_in_band(
    step: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep, target: np.ndarray
) -> np.ndarray:
    """Return the response of a playback in the control band, divided by the playback's level.

    Parameters
    ----------
    step : IterationStep or ConfirmationStep
        Step of the playback.
    target : ndarray, shape (responses, samples)
        Target in the control band.

    Returns
    -------
    ndarray, shape (responses, samples)
        Response as float64, in the units of the responses.

    Raises
    ------
    ArrayError
        If the step's array is damaged, or has another shape than the target.
    """
    if step.HasField("error_in_band"):
        return target - from_array(step.error_in_band, field="error_in_band", shape=target.shape, dtype=np.float32)
    found = from_array(step.response_in_band, field="response_in_band", shape=target.shape, dtype=np.float64)
    # A copy: a view would hold the whole message.
    return found.copy()
