"""Whole runs on the rig, put together from their signal blocks; also out of a file that was never finished."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duralab.errors import InputError
from duralab.recording.damage import within_contract
from duralab.recording.epochs import counting_epoch
from duralab.recording.mcap_file import McapFile
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2

_Pair = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class WholeRun:
    """Drive (drives, samples) and response (responses, samples) of a run, in the rig's units."""

    sample_rate: float
    drive: np.ndarray
    response: np.ndarray


def require_run_name(run: object, *, example: str) -> None:
    """Refuse what is no name of a run, e.g. a list of names; raises InputError with an example of how to ask."""
    if not isinstance(run, str):
        raise InputError(f"A run is {run!r}; give the name of each as a text of its own, e.g. {example}.")


def whole_run(file: McapFile, run: str, *, rig: rig_pb2.RigDescription, played: Mapping[str, int]) -> WholeRun:
    """Put the blocks of one run together again.

    Parameters
    ----------
    file : McapFile
        The recording's files.
    run : str
        Name of the run.
    rig : RigDescription
        Whose channels they are.
    played : mapping of str to int
        The epoch in which each run was played to its end.

    Returns
    -------
    WholeRun
        From its first sample to its last.

    Raises
    ------
    InputError
        No block of that run was recorded, or a block is missing: the last one too, where the run was broken off.
    """
    blocks, end, sample_rate = _blocks(file, run, rig=rig, played=played)
    drives, responses = zip(*_in_order(file.path, blocks, run), strict=True)
    if end != max(blocks):
        reached = max(blocks) + drives[-1].shape[1]
        repair = "" if file.whole else "start the recorder on its folder, which repairs it, then "
        raise InputError(
            f"{file.path} holds the run {run!r} up to sample {reached - 1} ({reached / sample_rate:g} s) only and "
            f"not its last block; {repair}read what is there with `responses({run!r})` and `drives({run!r})`."
        )
    return WholeRun(sample_rate, np.concatenate(drives, axis=1), np.concatenate(responses, axis=1))


def _blocks(
    file: McapFile, run: str, *, rig: rig_pb2.RigDescription, played: Mapping[str, int]
) -> tuple[dict[int, _Pair], int, float]:
    """Return the run's blocks by their first sample, the first sample of its last block or -1, and its rate."""
    written: dict[str, list[int]] = {}
    found: dict[int, dict[int, _Pair]] = {}
    ends: dict[int, int] = {}
    sample_rate, told = 0.0, played.get(run, 0)
    for epoch, block in file.with_epochs(rig_pb2.SignalBlock):
        epochs = written.setdefault(block.run, [])
        if epochs[-1:] != [epoch]:
            epochs.append(epoch)
        if block.run != run or told not in (0, epoch):
            continue
        with within_contract(file.path):
            drive = from_array(block.drive, field="drive", shape=(len(rig.drives), None))
            response = from_array(block.response, field="response", shape=(len(rig.responses), None))
        found.setdefault(epoch, {})[block.first_sample], sample_rate = (drive, response), block.sample_rate
        if block.last:
            ends[epoch] = block.first_sample
    counting = {name: counting_epoch(epochs, played=played.get(name, 0)) for name, epochs in written.items()}
    if counting.get(run) not in found:
        names = [name for name, epochs in written.items() if counting[name] in epochs]
        raise InputError(f"{file.path} holds no signals of a run {run!r}; it holds {', '.join(names) or 'none'}.")
    return found[counting[run]], ends.get(counting[run], -1), sample_rate


def _in_order(path: Path, blocks: Mapping[int, _Pair], run: str) -> Iterator[_Pair]:
    """Yield blocks by their first sample: one that was lost on the way and fetched later is written late."""
    reached = 0
    for first in sorted(blocks):
        if first > reached:
            raise InputError(f"{path} lacks the samples {reached} to {first - 1} of the run {run!r}.")
        if first < reached:
            raise InputError(f"{path} holds the samples {first} to {reached - 1} of the run {run!r} twice.")
        yield blocks[first]
        reached += blocks[first][0].shape[1]
