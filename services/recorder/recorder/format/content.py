"""Content of the files of a recording, read in order: steps, playbacks, blocks, attachments."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Final

from google.protobuf.message import Message as ProtoMessage
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from duralab_bus import Continuity
from duralab_proto.keys import rig_of, run_of
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from duralab_recordings import EPOCH, PART_METADATA, SUMMARY_METADATA
from recorder.format.steps import leaves_samples_out, type_name_of
from recorder.format.summary import PlannedRun, Runs, Story, Streams, Summary


class SampleOrder:
    """Compares the first sample of each block with the end of the block before it; blocks may come in any order.

    Memory grows with the number of gaps between the blocks, not with their number.
    """

    def __init__(self) -> None:
        # Required and found first sample of each block number, until the other of the two is known.
        self._expected: dict[int, int] = {0: 0}
        self._found: dict[int, int] = {}
        self._misfit: tuple[int, int, int] | None = None

    def take(self, number: int, *, first: int, count: int) -> None:
        """Add a block that was not added before."""
        self._compare(number, self._expected.pop(number, None), first, keep=self._found)
        self._compare(number + 1, self._found.pop(number + 1, None), first + count, keep=self._expected)

    def _compare(self, number: int, known: int | None, sample: int, *, keep: dict[int, int]) -> None:
        if known is None:
            keep[number] = sample
        elif known != sample and self._misfit is None:
            begins, ends = (sample, known) if keep is self._found else (known, sample)
            self._misfit = (number, begins, ends)

    @property
    def finding(self) -> str:
        """The first two blocks that do not join, as text; empty if all join."""
        if self._misfit is None:
            return ""
        number, begins, ends = self._misfit
        if number == 0:
            return f"its first block begins at sample {begins}"
        return f"block {number} begins at sample {begins}, the one before it ends at {ends}"


STEP_TOPIC: Final = "step/"
"""Committed steps are on `step/<short name of the message>`, numbered by their sequence."""

STORED_ONCE: Final = (rig_pb2.RigState, iterator_pb2.CampaignEvent)
"""Messages of streams that are replayed after a kill, besides signal blocks."""

SCENARIO_METADATA: Final = "scenario"
SOFTWARE_METADATA: Final = "software"

_STEPS_READ: Final[dict[str, type[ProtoMessage]]] = {
    type_name_of(kind): kind
    for kind in (
        *(recorder_pb2.RunPlanned, recorder_pb2.RunPlayed, rig_pb2.RigDescription),
        *(iterator_pb2.IterationStep, iterator_pb2.ConfirmationStep),
        *(iterator_pb2.CampaignSpec, iterator_pb2.CampaignStatus),
        *(iterator_pb2.PreTestRequest, iterator_pb2.PreTest),
        *(sequencer_pb2.EnduranceSpec, sequencer_pb2.EnduranceVolume),
        *(sequencer_pb2.EnduranceRepeat, sequencer_pb2.EnduranceStatus),
    )
}
"""Steps whose content is read, not only hashed."""

_TYPES_STORED_ONCE: Final = tuple(type_name_of(kind) for kind in STORED_ONCE)


@dataclass
class Content:
    """Content read so far; `take` adds a file.

    `steps`: Full name of the message and SHA-256 of the payload of each step. `blocks`, `samples`: Signal blocks of
    each rig, run and epoch, and whether their samples follow each other. `named`: Run, epoch and hash of the samples
    that steps leave out. `streams`: States and events of each key and epoch. `part`: Metadata `part` of the file read
    last: its place in the recording. `attachments`: SHA-256 by name; only recordings of format version 1 have some.
    `scenario`: Metadata of the campaign's YAML.
    """

    steps: dict[int, tuple[str, str]] = field(default_factory=dict)
    last_step_type: str = ""
    blocks: dict[tuple[str, str, int], Continuity] = field(default_factory=dict)
    samples: dict[tuple[str, str, int], SampleOrder] = field(default_factory=dict)
    named: list[tuple[str, int, str]] = field(default_factory=list)
    streams: Streams = field(default_factory=dict)
    planned: list[recorder_pb2.RunPlanned] = field(default_factory=list)
    played: list[recorder_pb2.RunPlayed] = field(default_factory=list)
    descriptions: dict[str, rig_pb2.RigDescription] = field(default_factory=dict)
    attachments: dict[str, str] = field(default_factory=dict)
    scenario: dict[str, str] = field(default_factory=dict)
    story: Story = field(default_factory=Story)
    summary: Summary | None = None
    part: dict[str, str] = field(default_factory=dict)
    messages: int = 0
    _schemas: dict[int, str] = field(default_factory=dict)
    """Full message names of the current file by schema number."""

    _channels: dict[int, Channel] = field(default_factory=dict)
    """Channels of the current file by number."""

    def begin_file(self) -> None:
        """Clear the state of a single file."""
        self.part = {}
        self.summary = None
        self._schemas, self._channels = {}, {}

    def take(self, record: McapRecord) -> None:
        """Add a record; raises one of DAMAGE if a recorder does not write such a record."""
        match record:
            case Schema():
                self._schemas[record.id] = record.name
            case Channel():
                self._channels[record.id] = record
            case Message():
                self.messages += 1
                self._take_message(record)
            case Attachment():
                self.attachments[record.name] = hashlib.sha256(record.data).hexdigest()
            case Metadata():
                self._take_metadata(record)

    def _take_metadata(self, record: Metadata) -> None:
        match record.name:
            case name if name == SUMMARY_METADATA:
                self.summary = Summary.from_metadata(record.metadata)
            case name if name == PART_METADATA:
                self.part = dict(record.metadata)
            case name if name == SCENARIO_METADATA:
                self.scenario = dict(record.metadata)

    def _take_message(self, message: Message) -> None:
        channel = self._channels[message.channel_id]
        schema = self._schemas[channel.schema_id]
        if channel.topic.startswith(STEP_TOPIC):
            self._take_step(message, schema)
        elif schema == type_name_of(rig_pb2.SignalBlock):
            place = (rig_of(channel.topic), run_of(channel.topic), int(channel.metadata[EPOCH]))
            self.blocks.setdefault(place, Continuity()).accept(message.sequence)
            block = rig_pb2.SignalBlock.FromString(message.data)
            count = block.response.shape[-1] if block.response.shape else 0
            self.samples.setdefault(place, SampleOrder()).take(message.sequence, first=block.first_sample, count=count)
        elif schema in _TYPES_STORED_ONCE:
            place = (channel.topic, int(channel.metadata[EPOCH]))
            self.streams.setdefault(place, Continuity()).accept(message.sequence)

    def _take_step(self, message: Message, schema: str) -> None:
        self.steps[message.sequence] = (schema, hashlib.sha256(message.data).hexdigest())
        self.last_step_type = schema
        if message.sequence == 0:
            self.story = Story(begun=message.log_time)
        kind = _STEPS_READ.get(schema)
        match step := kind and kind.FromString(message.data):
            case None:
                return
            case recorder_pb2.RunPlanned():
                if not step.not_kept:
                    self.planned.append(step)
            case recorder_pb2.RunPlayed():
                self.played.append(step)
            case rig_pb2.RigDescription():
                self.descriptions[step.rig] = step
            case _ if leaves_samples_out(step):
                self.named.append((step.run, step.signal_epoch, step.samples_hash))
        self.story = self.story.after(step)

    @property
    def step_numbers(self) -> list[int]:
        """Numbers of the steps, ascending."""
        return sorted(self.steps)

    def runs(self, recording: str) -> Runs:
        """Return the announced playbacks with their stored blocks."""
        runs: Runs = {(planned.rig, planned.run): PlannedRun(recording) for planned in self.planned}
        for played in self.played:
            runs.setdefault((played.rig, played.run), PlannedRun(recording)).played = played
        for (rig, name, epoch), continuity in self.blocks.items():
            if (rig, name) in runs:
                runs[rig, name].epochs[epoch] = continuity
        return runs

    def summary_now(self, recording: str, *, reason: str) -> Summary:
        """Return the summary of all content read so far."""
        steps = [self.steps[number] for number in self.step_numbers]
        return Summary(
            recording=recording,
            reason=reason,
            step_types=tuple(kind for kind, _ in steps),
            step_hashes=tuple(payload_hash for _, payload_hash in steps),
            runs=self.runs(recording),
            attachments=dict(self.attachments),
            story=self.story,
            streams=self.streams,
        )
