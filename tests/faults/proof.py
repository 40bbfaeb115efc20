"""Is everything in the recording, once and in order? Read from the files by MCAP's own reader, not by the recorder."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from duralab_proto.arrays import from_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2

from .reference import playback_hash, samples_hash


@dataclass
class Proof:
    """What the files of one recording hold."""

    lost: int = 0
    doubled: int = 0
    reordered: int = 0
    closed: bool = False
    findings: list[str] = field(default_factory=list)
    playbacks: list[str] = field(default_factory=list)
    """Hash of drive and response of every playback."""


def files_of(folder: Path, recording: str) -> list[Path]:
    """Return the files of a recording in their order: `<id>.mcap`, then `<id>.part02.mcap` and so on."""
    return [
        *folder.glob(f"{recording}.mcap"),
        *sorted(folder.glob(f"{recording}.part*.mcap")),
    ]


def prove(folder: Path, recording: str, *, rig: str) -> Proof:
    """Read a recording from end to end.

    Counts the signal blocks of every run that was played: numbers without a gap are lost where one is missing, doubled
    where one comes twice, reordered where one comes after a larger one. Samples of a playback's blocks are compared
    with those that were committed.
    """
    proof = Proof()
    steps: list[int] = []
    numbers: dict[tuple[str, int], list[int]] = defaultdict(list)
    blocks: dict[tuple[str, int], list[rig_pb2.SignalBlock]] = defaultdict(list)
    played: list[recorder_pb2.RunPlayed] = []
    playbacks: dict[str, iterator_pb2.IterationStep] = {}
    paths = files_of(folder, recording)
    if not paths:
        proof.findings.append(f"{recording}: there is no file")
    for topic, epoch, sequence, kind, data in (record for path in paths for record in _records(path)):
        if topic.startswith("step/"):
            steps.append(sequence)
        if kind == rig_pb2.SignalBlock.DESCRIPTOR.full_name:
            block = rig_pb2.SignalBlock.FromString(data)
            numbers[block.run, epoch].append(sequence)
            blocks[block.run, epoch].append(block)
        elif kind == recorder_pb2.RunPlayed.DESCRIPTOR.full_name:
            played.append(recorder_pb2.RunPlayed.FromString(data))
        elif kind == iterator_pb2.IterationStep.DESCRIPTOR.full_name:
            step = iterator_pb2.IterationStep.FromString(data)
            proof.playbacks.append(playback_hash(step))
            playbacks[step.run] = step
        elif kind == identifier_pb2.Model.DESCRIPTOR.full_name:
            identifier_pb2.Model.FromString(data)
        elif kind == recorder_pb2.RecordingClosed.DESCRIPTOR.full_name:
            proof.closed = True
    if steps != list(range(len(steps))):
        proof.findings.append(f"{recording}: the steps are numbered {steps}")
    for found in numbers.values():
        proof.doubled += len(found) - len(set(found))
        proof.reordered += sum(later < earlier for earlier, later in itertools.pairwise(found))
    for run in played:
        proof.lost += run.blocks - len(set(numbers[run.run, run.epoch]))
        if run.run in playbacks:
            proof.findings += _compare(playbacks[run.run], blocks[run.run, run.epoch])
    if len(played) != len({run.run for run in played}):
        proof.findings.append(f"{recording}: a run is said to be played twice")
    for planned in {run for run, _ in numbers} - {run.run for run in played}:
        # Broken off: what was published has no proof of its end, but must be without a gap as far as it goes.
        for (run, _), found in numbers.items():
            if run == planned and sorted(found) != list(range(len(found))):
                proof.findings.append(f"{recording}: the run {run} on {rig}, broken off, holds blocks {found}")
    return proof


def _compare(step: iterator_pb2.IterationStep, blocks: list[rig_pb2.SignalBlock]) -> Iterator[str]:
    if not step.HasField("response"):
        ordered = sorted(blocks, key=lambda block: block.first_sample)
        drive, response = (
            np.concatenate([from_array(getattr(block, name)) for block in ordered], axis=1)
            for name in ("drive", "response")
        )
        if samples_hash(drive, response) != step.samples_hash:
            yield f"{step.run}: the samples of its blocks are not those of the hash that was committed"
        return
    for name, record in (("drive", step.drive), ("response", step.response)):
        whole = from_array(record.samples, field=name)
        first = 0
        for block in sorted(blocks, key=lambda block: block.first_sample):
            part = from_array(getattr(block, name), field=name)
            if block.first_sample != first or part.tobytes() != whole[:, first : first + part.shape[1]].tobytes():
                yield f"{step.run}: the {name} of the block at sample {block.first_sample} is not what was committed"
                return
            first += part.shape[1]
        if first != whole.shape[1]:
            yield f"{step.run}: its blocks hold {first} of {whole.shape[1]} samples"
            return


def _records(path: Path) -> Iterator[tuple[str, int, int, str, bytes]]:
    """Yield topic, epoch, sequence number, type and bytes of every message, also of a file without its end."""
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                match record:
                    case Schema():
                        schemas[record.id] = record.name
                    case Channel():
                        channels[record.id] = record
                    case Message():
                        channel = channels[record.channel_id]
                        epoch = int(channel.metadata.get("epoch", "0"))
                        yield channel.topic, epoch, record.sequence, schemas[channel.schema_id], record.data
        except EndOfFile:
            return
