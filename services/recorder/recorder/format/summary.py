"""Metadata `summary` at the end of each file of a recording: everything stored so far.

A recorder continues the recording from it without reading earlier files; a reader checks its data against it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from google.protobuf.message import Message

from duralab_bus import Continuity
from duralab_proto.v1 import iterator_pb2, recorder_pb2, sequencer_pb2
from duralab_recordings import DAMAGE, SUMMARY_METADATA, is_finished, last_metadata

MOST_BLOCKS: Final = 2**32
"""Largest number of blocks in one playback: the log keeps 32 bits of a sequence number."""


def ranges_of(continuity: Continuity) -> list[range]:
    """Return the received numbers as ascending ranges that do not touch."""
    edges = [0]
    for gap in continuity.missing(continuity.next_seq):
        edges += [gap.start, gap.stop]
    edges.append(continuity.next_seq)
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [range(first, stop) for first, stop in pairs if first < stop]


@dataclass
class PlannedRun:
    """A playback that was announced to a recording, and the blocks stored of each epoch of its publisher."""

    recording: str
    played: recorder_pb2.RunPlayed | None = None
    # One count for each publisher: a playback repeated after a fault has a new epoch.
    epochs: dict[int, Continuity] = field(default_factory=dict)

    @property
    def stored(self) -> int:
        """Number of different blocks stored."""
        return sum(continuity.received for continuity in self.epochs.values())

    @property
    def missing(self) -> int:
        """Number of blocks known to be missing: of all announced blocks, or the gaps seen so far."""
        if self.played is not None:
            return sum(len(gap) for gap in self.gaps_of(self.played.epoch, self.played.blocks))
        return sum(continuity.next_seq - continuity.received for continuity in self.epochs.values())

    def gaps_of(self, epoch: int, blocks: int) -> list[range]:
        """Return the ranges of the first `blocks` blocks of an epoch that are not stored."""
        return self.epochs.get(epoch, Continuity()).missing(blocks)


# Any client may publish a state with any number of 64 bits, and it is written.
_MOST_NUMBERS: Final = 2**64

Runs = dict[tuple[str, str], PlannedRun]
"""Playbacks by rig and run."""

Streams = dict[tuple[str, int], Continuity]
"""Stored messages of streams other than playbacks, by key and epoch."""


_ENDS: Final = {
    sequencer_pb2.ENDURANCE_PHASE_FINISHED: iterator_pb2.CAMPAIGN_PHASE_FINISHED,
    sequencer_pb2.ENDURANCE_PHASE_STOPPED: iterator_pb2.CAMPAIGN_PHASE_STOPPED,
    sequencer_pb2.ENDURANCE_PHASE_FAULTED: iterator_pb2.CAMPAIGN_PHASE_FAULTED,
}


@dataclass(frozen=True)
class Story:
    """Subject of a recording, and its begin in nanoseconds since 1970 UTC; empty or 0 if unknown."""

    rig: str = ""
    target: str = ""
    begun: int = 0
    phase: iterator_pb2.CampaignPhase = iterator_pb2.CAMPAIGN_PHASE_UNSPECIFIED
    outcome: iterator_pb2.Outcome = iterator_pb2.OUTCOME_UNSPECIFIED
    pre_test: iterator_pb2.PreTestVerdict = iterator_pb2.PRE_TEST_VERDICT_UNSPECIFIED

    def after(self, step: Message) -> Story:
        """Return the story with the information of a step added."""
        return replace(self, **_added(step))


def _added(step: Message) -> dict[str, Any]:
    """Return the fields of the story that a step sets."""
    added: dict[str, Any] = {}
    match step:
        case iterator_pb2.CampaignSpec():
            added = {"rig": step.rig, "target": step.target_source}
        case iterator_pb2.CampaignStatus():
            added = {"phase": step.phase, "outcome": step.outcome}
        case iterator_pb2.PreTestRequest():
            added = {"rig": step.rig, "pre_test": iterator_pb2.PRE_TEST_VERDICT_UNFINISHED}
        case iterator_pb2.PreTest():
            added = {"pre_test": step.verdict}
        case sequencer_pb2.EnduranceSpec():
            added = {"rig": step.rig, "target": f"endurance test {step.id}"}
        case sequencer_pb2.EnduranceVolume() if step.first_repeat:
            added = {"rig": step.rig, "target": f"endurance test {step.id} from repeat {step.first_repeat}"}
        case sequencer_pb2.EnduranceStatus() if step.phase in _ENDS:
            added = {"phase": _ENDS[step.phase]}
    return added


@dataclass(frozen=True)
class Summary:
    """Summary of a recording at the end of a file: reason of the end, content stored so far, name of the next file.

    `step_types`, `step_hashes`: Full name of each step's message, and SHA-256 (hexadecimal) of its payload.
    """

    recording: str
    reason: str
    step_types: tuple[str, ...] = ()
    step_hashes: tuple[str, ...] = ()
    runs: Runs = field(default_factory=dict)
    attachments: dict[str, str] = field(default_factory=dict)
    story: Story = field(default_factory=Story)
    streams: Streams = field(default_factory=dict)
    next_file: str = ""

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.step_hashes)

    @property
    def signal_blocks(self) -> int:
        """Number of different blocks stored."""
        return sum(run.stored for run in self.runs.values())

    @property
    def missing_blocks(self) -> int:
        """Number of blocks known to be missing."""
        return sum(run.missing for run in self.runs.values())

    @property
    def ended(self) -> bool:
        """Whether the last step is RecordingClosed."""
        return bool(self.step_types) and self.step_types[-1] == recorder_pb2.RecordingClosed.DESCRIPTOR.full_name

    def to_metadata(self) -> dict[str, str]:
        """Return the summary as the texts of a metadata record."""
        return {
            "recording": self.recording,
            "reason": self.reason,
            "steps": str(self.steps),
            "step_types": json.dumps(self.step_types),
            "step_hashes": json.dumps(self.step_hashes),
            "signal_blocks": str(self.signal_blocks),
            "missing_blocks": str(self.missing_blocks),
            "runs": json.dumps([_run_entry(rig, name, run) for (rig, name), run in self.runs.items()]),
            "attachments": json.dumps(self.attachments),
            "story": json.dumps(vars(self.story)),
            "streams": json.dumps(
                [[key, epoch, _pairs(ranges_of(stored))] for (key, epoch), stored in self.streams.items()]
            ),
            "next_file": self.next_file,
        }

    @staticmethod
    def from_metadata(entries: Mapping[str, str]) -> Summary:
        """Return the summary of a metadata record; raises one of DAMAGE if its texts are not a summary."""
        try:
            return Summary(
                recording=entries["recording"],
                reason=entries["reason"],
                step_types=tuple(json.loads(entries.get("step_types", "[]"))),
                step_hashes=tuple(json.loads(entries["step_hashes"])),
                runs=dict(_run_of(entry, entries["recording"]) for entry in json.loads(entries.get("runs", "[]"))),
                attachments=dict(json.loads(entries.get("attachments", "{}"))),
                story=Story(**json.loads(entries.get("story", "{}"))),
                streams={
                    (str(key), int(epoch)): _continuity_of(pairs, f"messages on {key}", most=_MOST_NUMBERS)
                    for key, epoch, pairs in json.loads(entries.get("streams", "[]"))
                },
                next_file=entries.get("next_file", ""),
            )
        except (TypeError, AttributeError) as error:
            raise ValueError(f"The summary is not one of this recorder: {error}.") from error


def _run_entry(rig: str, name: str, run: PlannedRun) -> dict[str, object]:
    played = None if run.played is None else [run.played.epoch, run.played.blocks]
    stored = {str(epoch): _pairs(ranges_of(continuity)) for epoch, continuity in run.epochs.items()}
    return {"rig": rig, "run": name, "played": played, "stored": stored}


def _run_of(entry: Mapping[str, object], recording: str) -> tuple[tuple[str, str], PlannedRun]:
    match entry:
        case {"rig": str(rig), "run": str(name), "played": played, "stored": dict(stored)}:
            run = PlannedRun(recording)
        case _:
            raise ValueError(f"The summary's run {str(entry)[:80]!r} is not a valid entry.")
    if isinstance(played, list):
        epoch, blocks = played
        run.played = recorder_pb2.RunPlayed(run=name, rig=rig, epoch=epoch, blocks=blocks)
    for epoch, ranges in stored.items():
        run.epochs[int(epoch)] = _continuity_of(ranges, f"blocks of run {name!r}", most=MOST_BLOCKS)
    return (rig, name), run


def _pairs(ranges: Iterable[range]) -> list[list[int]]:
    return [[part.start, part.stop] for part in ranges]


def _continuity_of(pairs: Iterable[tuple[int, int]], what: str, *, most: int) -> Continuity:
    continuity = Continuity()
    for first, stop in pairs:
        if not 0 <= first <= stop <= most:
            raise ValueError(f"The summary's {what} from {first} to {stop} are not a valid range.")
        continuity.fill(range(first, stop))
    return continuity


def read_summary(path: Path) -> Summary | None:
    """Read the summary of a file through its index; None if it has none."""
    try:
        # The last one: a repaired file may also hold a summary whose recorder was killed before it finished the file.
        entries = last_metadata(path, SUMMARY_METADATA) if is_finished(path) else None
        return None if entries is None else Summary.from_metadata(entries)
    except DAMAGE:
        return None
