"""One open recording: its files in order, the order of its steps, and the summary at the end of each file."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum, auto
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from duralab_bus import Continuity, StreamItem
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import EPOCH, PART_METADATA, SUMMARY_METADATA, BlockPlace, block_places, part_metadata
from recorder.format import (
    SCENARIO_METADATA,
    SOFTWARE_METADATA,
    STEP_TOPIC,
    STORED_ONCE,
    Runs,
    Step,
    Story,
    Streams,
    Summary,
    recording_path,
    sha256_of,
)
from recorder.mcap_log import McapLog, holds_doubles_only
from recorder.refused import RefusedError


class Placement(Enum):
    """Result of the placement of a step."""

    NEW = auto()
    """The step is the next one: store it."""
    STORED = auto()
    """The step is already stored: acknowledge it."""


class StepOrder:
    """Order of the steps stored so far."""

    def __init__(self, recording: str) -> None:
        self._recording = recording
        # Full name of each step's message, and SHA-256 (hexadecimal) of its payload.
        self._steps: list[tuple[str, str]] = []

    @property
    def count(self) -> int:
        """Number of steps stored, which is the number of the next one."""
        return len(self._steps)

    @property
    def hashes(self) -> tuple[str, ...]:
        """SHA-256 (hexadecimal) of each step's payload."""
        return tuple(payload_hash for _, payload_hash in self._steps)

    @property
    def types(self) -> tuple[str, ...]:
        """Full name of each step's message."""
        return tuple(type_name for type_name, _ in self._steps)

    def restore(self, types: Sequence[str], hashes: Sequence[str]) -> None:
        """Set the steps that the recording's files hold, in order."""
        self._steps = list(zip(types, hashes, strict=True))

    @property
    def ended(self) -> bool:
        """Whether the last step, RecordingClosed, is stored."""
        return bool(self._steps) and self._steps[-1][0] == recorder_pb2.RecordingClosed.DESCRIPTOR.full_name

    def place(self, step: Step) -> Placement:
        """Return the treatment of a step without a change; raises RefusedError if it cannot be stored."""
        if step.number < self.count:
            if self._steps[step.number] == (step.type_name, step.payload_hash):
                return Placement.STORED
            raise RefusedError(
                query_pb2.FAULT_CODE_ALREADY_EXISTS,
                f"Step {step.number} of recording {self._recording!r} is stored with another content; "
                f"a stored step is never changed, and the next one is {self.count}.",
                field="step",
            )
        if self.ended:
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {self._recording!r} is closed with {self.count} steps; commit to a new one.",
                field="recording",
            )
        if step.number > self.count:
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Step {step.number} of recording {self._recording!r} leaves a gap; the next step is {self.count}.",
                field="step",
            )
        return Placement.NEW

    def store(self, step: Step) -> None:
        """Add a step that `place` found NEW and that is on disk."""
        self._steps.append((step.type_name, step.payload_hash))


_NANOSECONDS: Final = 1e9
_LONGEST_SECONDS: Final = 1e9
# September 2001 and a day: an epoch outside of this range is not a time in nanoseconds.
_EARLIEST: Final = 10**18
_DAY: Final = 86_400 * 10**9


def software_versions() -> dict[str, str]:
    """Return the versions of the software that writes the recording."""
    packages = ("duralab-recorder", "duralab-proto", "mcap", "protobuf")
    return {"python": platform.python_version()} | {package: version(package) for package in packages}


class DiskError(RefusedError):
    """Refusal of a write by the disk: data after the last sync is not stored."""

    def __init__(self, recording: str, why: str) -> None:
        super().__init__(
            query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED,
            f"Recording {recording!r} cannot be written now ({why}); make room for it on the recorder's disk, it then "
            "goes on by itself.",
            field="recording",
        )
        self.why = why


@contextmanager
def as_disk_error(recording: str) -> Iterator[None]:
    """Raise an OSError as a DiskError."""
    try:
        yield
    except OSError as error:
        raise DiskError(recording, error.strerror or str(error)) from error


@dataclass
class Stored:
    """Content of the finished files of a recording; `streams` also includes messages not yet synced."""

    files: int = 0
    previous_sha256: str = ""
    attachments: dict[str, str] = field(default_factory=dict)
    scenario: dict[str, str] = field(default_factory=dict)
    story: Story = field(default_factory=Story)
    streams: Streams = field(default_factory=dict)


class Recording:
    """A recording that is written, one file after the other. Used by one thread."""

    def __init__(
        self, name: str, folder: Path, *, order: StepOrder | None = None, stored: Stored | None = None
    ) -> None:
        self.name = name
        self.order = order or StepOrder(name)
        self._folder = folder
        self._stored = stored or Stored()
        self._log: McapLog | None = None
        # Begin of runs in nanoseconds since 1970 UTC, by run and epoch.
        self._begins: dict[tuple[str, int], int] = {}

    @property
    def written(self) -> bool:
        """Whether a file is open."""
        return self._log is not None

    @property
    def bytes_written(self) -> int:
        """Size of the open file so far."""
        return 0 if self._log is None else self._log.bytes_written

    def place(self, step: Step) -> Placement:
        """Return the treatment of a step; see `StepOrder.place`."""
        return self.order.place(step)

    def store(self, step: Step) -> None:
        """Write a step that `place` found NEW, and return when it is on the disk."""
        with as_disk_error(self.name):
            log = self._writing()
            if isinstance(step.message, iterator_pb2.CampaignSpec):
                self._stored.scenario = {"campaign": step.message.id, "yaml": step.message.scenario}
                log.add_metadata(SCENARIO_METADATA, self._stored.scenario)
            kind = type(step.message)
            log.add_message(
                STEP_TOPIC + kind.DESCRIPTOR.name,
                step.payload,
                kind=kind,
                sequence=step.number,
                doubles=holds_doubles_only(step.message),
            )
            log.sync()
        self.order.store(step)
        story = self._stored.story if step.number else Story(begun=time.time_ns())
        self._stored.story = story.after(step.message)

    def add_stream(self, item: StreamItem[Any]) -> None:
        """Write a message of a stream under its key; it is on the disk after the next `sync`.

        A state or an event that is stored already is ignored: after a kill its publisher replays unacknowledged ones.
        """
        stored: Continuity | None = None
        if isinstance(item.message, STORED_ONCE):
            stored = self._stored.streams.setdefault((item.key, item.epoch), Continuity())
            if item.seq in stored:
                return
        with as_disk_error(self.name):
            self._writing().add_message(
                item.key,
                item.payload or item.message.SerializeToString(),
                kind=type(item.message),
                sequence=item.seq,
                metadata={EPOCH: str(item.epoch)},
                # Checked before: their arrays are float64.
                doubles=isinstance(item.message, rig_pb2.SignalBlock | rig_pb2.PoseBlock),
                publish_time=self._sample_time(item),
            )
        if stored is not None:
            stored.accept(item.seq)

    def _sample_time(self, item: StreamItem[Any]) -> int | None:
        """Return the time of the first sample of a message, so that tools for MCAP files draw a run over its time.

        The epoch of a publisher is the time of its start, and the begin of its run. None if a message has no samples.
        """
        match item.message:
            case rig_pb2.SignalBlock() as block:
                place = (block.run, item.epoch)
                if (begin := self._begins.get(place)) is None:
                    begin = self._begins[place] = _begin_of(item.epoch)
                seconds = block.first_sample / block.sample_rate
            case rig_pb2.PoseBlock() as pose:
                known = [begin for (run, _), begin in self._begins.items() if run == pose.run]
                times = from_array(pose.time, field="time", shape=(None,), finite=False)
                if not known or not times.size:
                    return None
                begin, seconds = known[-1], float(times[0])
            case _:
                return None
        return begin + round(_NANOSECONDS * seconds) if 0.0 <= seconds < _LONGEST_SECONDS else None

    def places(self, topic: str, *, epoch: int) -> list[BlockPlace]:
        """Return the places of the messages of a topic and epoch in all files, once they are on the disk."""
        self.sync()
        files = [recording_path(self._folder, self.name, number=number + 1) for number in range(self._stored.files)]
        found = [place for path in files for key, of, place in block_places(path) if (key, of) == (topic, epoch)]
        return found if self._log is None else found + self._log.places(topic, metadata={EPOCH: str(epoch)})

    def sync(self) -> None:
        """Flush all added data to the disk."""
        if self._log is not None:
            with as_disk_error(self.name):
                self._log.sync()

    def close(self, runs: Runs, *, reason: str, next_file: str = "") -> None:
        """Write the summary and finish the open file, if there is one."""
        log = self._log
        if log is None:
            return
        summary = Summary(
            recording=self.name,
            reason=reason,
            step_types=self.order.types,
            step_hashes=self.order.hashes,
            runs=runs,
            attachments=self._stored.attachments,
            story=self._stored.story,
            streams=self._stored.streams,
            next_file=next_file,
        )
        with as_disk_error(self.name):
            log.add_metadata(SUMMARY_METADATA, summary.to_metadata())
            log.close()
        self._stored.previous_sha256 = log.sha256
        self._stored.files += 1
        self._log = None

    def split(self, runs: Runs) -> None:
        """Finish the open file; the recording continues in the next without a gap."""
        following = recording_path(self._folder, self.name, number=self._stored.files + 2).name
        self.close(runs, reason=f"It goes on in {following}.", next_file=following)
        self._begin_file()

    def write_empty_file(self, runs: Runs, *, reason: str) -> None:
        """Write the next file without content, because the file before names it and it is missing."""
        self._begin_file()
        self.close(runs, reason=reason)

    def let_go(self) -> tuple[Path, int] | None:
        """Release a file that the disk refuses, without an end; return it and its number of safe bytes."""
        log, self._log = self._log, None
        if log is None:
            return None
        log.release()
        return log.path, log.synced_bytes

    def abandon(self) -> None:
        """Remove the file: nothing in it was acknowledged."""
        if self._log is not None:
            self._log.abandon()
            self._log = None

    def information(self, runs: Runs) -> recorder_pb2.RecordingInfo:
        """Return the contract's description of the recording in its present state."""
        return recorder_pb2.RecordingInfo(
            recording=self.name,
            steps=self.order.count,
            signal_blocks=sum(run.stored for run in runs.values()),
            missing_blocks=sum(run.missing for run in runs.values()),
            **vars(self._stored.story),
        )

    def _writing(self) -> McapLog:
        """Return the open file, or a new one if none is open."""
        if self._log is None:
            number = self._stored.files + 1
            previous = recording_path(self._folder, self.name, number=number - 1) if number > 1 else None
            if previous is not None and not self._stored.previous_sha256:
                self._stored.previous_sha256 = sha256_of(previous)
            self._log = McapLog(recording_path(self._folder, self.name, number=number))
            self._log.add_metadata(SOFTWARE_METADATA, software_versions())
            self._log.add_metadata(
                PART_METADATA,
                part_metadata(
                    self.name, number=number, previous=previous, previous_sha256=self._stored.previous_sha256
                ),
            )
            if self._stored.scenario:
                self._log.add_metadata(SCENARIO_METADATA, self._stored.scenario)
        return self._log

    def _begin_file(self) -> None:
        with as_disk_error(self.name):
            self._writing().sync()


def _begin_of(epoch: int) -> int:
    """Return the start of a publisher in nanoseconds since 1970 UTC: its epoch, or now if that is not such a time."""
    now = time.time_ns()
    return epoch if _EARLIEST <= epoch <= now + _DAY else now
