"""All open recordings of a folder: commits, streams and closing. Used by one thread, the log's only writer."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog

from duralab_bus import Continuity, StreamItem
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.keys import id_of, rig_of, run_of
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import BlockPlace
from recorder.format import MOST_BLOCKS, PlannedRun, Step, files_of, leaves_samples_out, recordings_in
from recorder.log.interruptions import Interruptions
from recorder.log.recording import DiskError, Placement, Recording, StepOrder, as_disk_error
from recorder.log.recovery import LEAST_FREE_BYTES, MEBIBYTE, FreeSpaceGuard, is_ended, reopen
from recorder.mcap_log import holds_doubles_only
from recorder.refused import RefusedError


class RunRegistry:
    """Playbacks of all open recordings, by rig and run."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str], PlannedRun] = {}
        # Bounded, because clients may play runs of no recording as long as the lab runs.
        self._strangers: deque[str] = deque(maxlen=100)

    def find(self, rig: str, run: str) -> PlannedRun | None:
        """Return a playback that was announced, or None."""
        return self._runs.get((rig, run))

    def rig_of(self, recording: str, run: str) -> str:
        """Return the rig on which a run was announced to a recording; empty if it was not announced."""
        return next((rig for rig, name in self.of_recording(recording) if name == run), "")

    def is_not_kept(self, run: str) -> bool:
        """Return whether a run is one of the last whose blocks are not kept."""
        return run in self._strangers

    def is_new_stranger(self, run: str) -> bool:
        """Return whether a run of no recording is seen for the first time."""
        if run in self._strangers:
            return False
        self._strangers.append(run)
        return True

    def check(self, message: recorder_pb2.RunPlanned | recorder_pb2.RunPlayed, recording: str) -> None:
        """Raise a RefusedError if the announcement contradicts an earlier one."""
        known = self.find(message.rig, message.run)
        if isinstance(message, recorder_pb2.RunPlanned):
            if known is not None and known.recording != recording:
                raise RefusedError(
                    query_pb2.FAULT_CODE_ALREADY_EXISTS,
                    f"The run {message.run!r} on rig {message.rig!r} belongs to recording {known.recording!r}; "
                    "choose another name for it.",
                    field="payload.run",
                )
            return
        if known is None or known.recording != recording:
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"The run {message.run!r} on rig {message.rig!r} was not announced to recording {recording!r}; "
                "commit RunPlanned before it is played.",
                field="payload.run",
            )

    def note(self, message: recorder_pb2.RunPlanned | recorder_pb2.RunPlayed, recording: str) -> None:
        """Note an announcement that was checked and stored."""
        if isinstance(message, recorder_pb2.RunPlanned) and message.not_kept:
            self._strangers.append(message.run)
            return
        run = self._runs.setdefault((message.rig, message.run), PlannedRun(recording))
        if isinstance(message, recorder_pb2.RunPlayed):
            run.played = message

    def is_new(self, run: PlannedRun, epoch: int, seq: int) -> bool:
        """Return whether a block must be stored: it is new and its number is possible."""
        return seq < MOST_BLOCKS and (epoch not in run.epochs or seq not in run.epochs[epoch])

    def accept(self, run: PlannedRun, epoch: int, seq: int) -> None:
        """Note a block that was stored."""
        run.epochs.setdefault(epoch, Continuity()).accept(seq)

    def of_recording(self, recording: str) -> dict[tuple[str, str], PlannedRun]:
        """Return the playbacks of a recording, by rig and run."""
        return {key: run for key, run in self._runs.items() if run.recording == recording}

    def recordings_of_rig(self, rig: str) -> set[str]:
        """Return the recordings that announced a playback on a rig."""
        return {run.recording for (of, _), run in self._runs.items() if of == rig}

    def restore(self, runs: Mapping[tuple[str, str], PlannedRun]) -> None:
        """Add the playbacks of a recording from its files."""
        self._runs.update(runs)

    def forget(self, recording: str) -> None:
        """Drop the playbacks of a recording that is closed or read again."""
        for key in self.of_recording(recording):
            del self._runs[key]


STOPPED: Final = "the recorder was stopped"
SPLIT_BYTES: Final = 512 * MEBIBYTE
REMEMBERED: Final = 50

_Files = tuple[tuple[str, int, int, int], ...]


class RecentlyClosed:
    """Steps of the recordings that ended last: a step sent again is acknowledged without reading their files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[StepOrder, _Files]] = {}

    def remember(self, name: str, order: StepOrder) -> None:
        """Store the steps of a recording whose last file is closed; beyond `REMEMBERED` the oldest is dropped."""
        self._known[name] = (order, self._files(name))
        if len(self._known) > REMEMBERED:
            del self._known[next(iter(self._known))]

    def find(self, name: str) -> StepOrder | None:
        """Return the steps of a recording; None if they are unknown or its files have changed."""
        order, files = self._known.get(name, (None, ()))
        if order is not None and files != self._files(name):
            del self._known[name]
            return None
        return order

    def _files(self, name: str) -> _Files:
        found = [(path.name, path.stat()) for path in files_of(self._folder, name)]
        return tuple((file, status.st_ino, status.st_size, status.st_mtime_ns) for file, status in found)


class Archive:
    """Recordings of a folder that are written now, and those that may be continued.

    `split_bytes`: Size at which a file is finished and the next one begun. `least_free_bytes`: No playback is begun,
    and no interrupted recording reopened, while less is free on the disk.
    """

    def __init__(
        self, folder: Path, *, split_bytes: int = SPLIT_BYTES, least_free_bytes: int = LEAST_FREE_BYTES
    ) -> None:
        self._folder = folder
        self._split_bytes = split_bytes
        self._free_space = FreeSpaceGuard(folder, least_free_bytes)
        self._open: dict[str, Recording] = {}
        self._recently_closed = RecentlyClosed(folder)
        self._runs = RunRegistry()
        self._descriptions: dict[tuple[str, str], rig_pb2.RigDescription] = {}
        self._interruptions = Interruptions()
        # Stream messages that are written but not yet synced, and those that need no further work.
        self._unsynced: dict[str, list[StreamItem[Any]]] = {}
        self._settled: list[StreamItem[Any]] = []
        self._log = structlog.get_logger("recorder")

    def recover(self) -> None:
        """Reopen unfinished recordings; log those that cannot be recovered and leave them unchanged."""
        for name in recordings_in(self._folder):
            try:
                if not is_ended(self._folder, name):
                    self._take_up(name)
            except (OSError, DiskError) as error:
                self._interruptions.begin_unread(name, error)
                self._log.error("a recording waits for its repair", recording=name, why=str(error))
            except RefusedError as refusal:
                self._log.warning("a recording cannot be gone on with", recording=name, why=refusal.message)

    def _take_up(self, name: str, *, reason: str = "") -> Recording | None:
        how = {"keep_original": False, "reason": f"The disk refused it: {reason}."} if reason else {}
        found = reopen(self._folder, name, least_free_bytes=self._free_space.least_bytes, **how)
        if found is None:
            return None
        if found.ended:
            self._recently_closed.remember(name, found.recording.order)
            return None
        self._open[name] = found.recording
        self._runs.forget(name)
        self._runs.restore(found.runs)
        for rig, description in found.descriptions.items():
            self._descriptions[name, rig] = description
        self._log.info("recording taken up", recording=name, steps=found.recording.order.count)
        return found.recording

    def commit(self, name: str, step: Step, *, samples_hash: str = "") -> Placement:
        """Store a step and return when it is on the disk or was already stored.

        `samples_hash`: Hash of the samples on disk of the run that the step refers to; empty if they are not complete.
        FAILED_PRECONDITION if the step is not the next one or its samples are missing; RESOURCE_EXHAUSTED if the disk
        refuses it: it may be sent again.
        """
        self.go_on(name)
        recording = self._open.get(name)
        with as_disk_error(name):
            if recording is None and self._recently_closed.find(name) is None:
                recording = self._take_up(name)
            ended = self._recently_closed.find(name)
        if ended is not None:
            return ended.place(step)
        placement = StepOrder(name).place(step) if recording is None else recording.place(step)
        if placement is Placement.STORED:
            return placement
        if isinstance(step.message, recorder_pb2.RunPlanned | recorder_pb2.RunPlayed):
            self._runs.check(step.message, name)
        if leaves_samples_out(step.message) and step.message.samples_hash != samples_hash:
            why = "are others than those of its hash" if samples_hash else "are not here, or not whole"
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"The signal blocks of run {step.message.run!r} {why}; send the step with its samples.",
                field="payload.samples_hash",
            )
        if recording is None or isinstance(step.message, recorder_pb2.RunPlanned):
            self._free_space.expect(name)
        if recording is None:
            # Only now, when nothing but the disk can refuse it: a refused first step leaves no file.
            recording = self._open[name] = Recording(name, self._folder)
            self._log.info("recording opened", recording=name)
        with self._interrupted_by_disk(recording):
            recording.store(step)
            self._note(recording, step)
        return placement

    def go_on(self, name: str) -> None:
        """Resume a recording that its disk interrupted; raises RefusedError while the disk refuses it."""
        if name in self._interruptions:
            self._take_up_interrupted(name)
        if name in self._interruptions:
            # The disk refused the held messages again.
            raise DiskError(name, self._interruptions[name].why)

    @contextmanager
    def _interrupted_by_disk(self, recording: Recording) -> Iterator[None]:
        """Release a recording whose disk refuses a write; acknowledged data stays, the rest is written again."""
        try:
            yield
        except DiskError as error:
            name = recording.name
            self._log.error("a recording is interrupted", recording=name, why=error.why)
            del self._open[name]
            if recording.order.count == 0:
                recording.abandon()
                self._runs.forget(name)
            else:
                self._interruptions.begin(name, why=error.why, file=recording.let_go())
                self._interruptions[name].held += self._unsynced.pop(name, [])
            raise

    def _take_up_interrupted(self, name: str) -> None:
        """Resume an interrupted recording; raises RefusedError while its disk refuses it."""
        why = "" if self._interruptions[name].unread else self._interruptions[name].why
        self._free_space.expect(name)
        try:
            with as_disk_error(name):
                self._interruptions.cut(name)
                self._take_up(name, reason=why)
        except DiskError:
            raise
        except RefusedError:
            self._take_held(name)
            raise
        self._take_held(name)

    def _take_held(self, name: str) -> None:
        """Process the messages held for a recording while it was interrupted."""
        held = self._interruptions.pop(name).held
        if name not in self._open:
            # Its last step is on the disk with all earlier data, or there is no recording to continue.
            self._forget(name)
            held, self._settled = [], self._settled + held
        for item in held:
            if isinstance(item.message, rig_pb2.SignalBlock):
                self.take_block(item)
            else:
                self._add_stream(name, item)
        for item in self._interruptions.take_unclaimed():
            if isinstance(item.message, rig_pb2.SignalBlock):
                self.take_block(item)
            else:
                self.take_state(item)

    def _note(self, recording: Recording, step: Step) -> None:
        """Update the state from a step that is on the disk."""
        name, message = recording.name, step.message
        match message:
            case recorder_pb2.RunPlanned() | recorder_pb2.RunPlayed():
                self._runs.note(message, name)
            case rig_pb2.RigDescription():
                self._descriptions[name, message.rig] = message
            case recorder_pb2.RecordingClosed():
                self._close(recording, reason=message.reason)

    def _forget(self, name: str) -> None:
        """Drop the playbacks and rigs of a recording."""
        self._runs.forget(name)
        self._descriptions = {key: value for key, value in self._descriptions.items() if key[0] != name}

    def gaps(self, name: str, played: recorder_pb2.RunPlayed) -> list[range]:
        """Return the missing block numbers of a playback; empty if it was not announced to this recording."""
        run = self._runs.find(played.rig, played.run)
        return [] if run is None or run.recording != name else run.gaps_of(played.epoch, played.blocks)

    def rig_of(self, name: str, run: str) -> str:
        """Return the rig on which a run of a recording was announced; empty if it was not announced."""
        return self._runs.rig_of(name, run)

    def places(self, name: str, topic: str, *, epoch: int) -> list[BlockPlace]:
        """Return the places of a run's signal blocks on the disk; empty if its recording is not open."""
        recording = self._open.get(name)
        if recording is None:
            return []
        with self._interrupted_by_disk(recording):
            return recording.places(topic, epoch=epoch)

    def take_block(self, item: StreamItem[rig_pb2.SignalBlock]) -> str | None:
        """Write a signal block; return its recording, or None if it has none."""
        rig, name = rig_of(item.key), run_of(item.key)
        run = self._runs.find(rig, name)
        if run is None:
            self._take_unclaimed(item)
        elif run.recording in self._interruptions:
            self._interruptions[run.recording].held += [item]
        elif not self._runs.is_new(run, item.epoch, item.seq):
            # Not settled at once: the first copy may not be on the disk yet.
            self._unsynced.setdefault(run.recording, []).append(item)
        elif fault := _check_block(item.message, run=name, description=self._descriptions.get((run.recording, rig))):
            self._log.warning("a signal block is refused", run=name, rig=rig, seq=item.seq, why=fault)
            self._settled.append(item)
        elif self._add_stream(run.recording, item):
            self._runs.accept(run, item.epoch, item.seq)
            return run.recording
        return None

    def _take_unclaimed(self, item: StreamItem[rig_pb2.SignalBlock]) -> None:
        """Discard a block of no recording, unless a recording with unread files may claim it."""
        if self._interruptions.hold_unclaimed(item):
            return
        if self._runs.is_new_stranger(run_of(item.key)):
            self._log.info("a run of no recording is not kept", run=run_of(item.key), rig=rig_of(item.key))
        self._settled.append(item)

    def take_state(self, item: StreamItem[rig_pb2.RigState]) -> set[str]:
        """Write a rig's state to the recordings with a playback on it that continue; return them."""
        if self._runs.is_not_kept(item.message.run):
            self._settled.append(item)
            return set()
        named = self._runs.recordings_of_rig(rig_of(item.key))
        run = self._runs.find(rig_of(item.key), item.message.run)
        playing = "" if run is None or run.played is not None else run.recording
        # Not to a recording that was interrupted long ago and is only ready to be resumed.
        names = {name for name in named if name == playing or name not in self._open or self._open[name].written}
        if not names and not self._interruptions.hold_unclaimed(item):
            self._settled.append(item)
        return {name for name in names if self._add_stream(name, item)}

    def take_pose(self, item: StreamItem[rig_pb2.PoseBlock]) -> str | None:
        """Write body poses to the recording of their run; return it, or None if they have none."""
        run = self._runs.find(rig_of(item.key), item.message.run)
        # Poses are only for display and may have gaps: they are dropped while the disk refuses writes.
        if run is None or run.recording in self._interruptions or not holds_doubles_only(item.message):
            return None
        return run.recording if self._add_stream(run.recording, item) else None

    def take_event(self, item: StreamItem[iterator_pb2.CampaignEvent]) -> str | None:
        """Write a campaign's event to its recording; return its id, or None if it is not open."""
        name = id_of(item.key)
        known = name in self._open or name in self._interruptions
        if not known or item.message.status.id != name:
            self._settled.append(item)
            return None
        return name if self._add_stream(name, item) else None

    def _add_stream(self, name: str, item: StreamItem[Any]) -> bool:
        """Write a stream message; if the disk refuses it, it is held until the disk accepts it."""
        recording = self._open.get(name)
        if recording is None:
            self._interruptions[name].held += [item]
            return False
        self._unsynced.setdefault(name, []).append(item)
        try:
            with self._interrupted_by_disk(recording):
                recording.add_stream(item)
        except DiskError:
            return False
        return True

    def sync(self) -> None:
        """Flush to disk, split large files, and resume interrupted recordings."""
        for name, recording in list(self._open.items()):
            try:
                with self._interrupted_by_disk(recording):
                    recording.sync()
                    self._settled += self._unsynced.pop(name, [])
                    if recording.bytes_written >= self._split_bytes:
                        recording.split(self._runs.of_recording(name))
            except DiskError:
                continue
        if given_up := self._interruptions.take_given_up():
            self._log.error("what may be of a recording that cannot be read is not kept", messages=len(given_up))
            self._settled += given_up
        for name in self._interruptions.due():
            try:
                self._take_up_interrupted(name)
            except DiskError as refusal:
                self._interruptions[name].postpone()
                self._log.debug("a recording waits", recording=name, why=refusal.message)
            except RefusedError as refusal:
                self._log.warning("a recording cannot be gone on with", recording=name, why=refusal.message)

    def settle(self, item: StreamItem[Any]) -> None:
        """Mark a stream message as settled: it needs no further work."""
        self._settled.append(item)

    def take_settled(self) -> list[StreamItem[Any]]:
        """Return the stream messages that were stored or discarded since the last call."""
        settled, self._settled = self._settled, []
        return settled

    def information(self, name: str) -> recorder_pb2.RecordingInfo | None:
        """Return the description of a recording that is open, without its files; None if it is not open."""
        recording = self._open.get(name)
        return recording.information(self._runs.of_recording(name)) if recording and recording.written else None

    def waiting(self, name: str) -> str:
        """Return why a recording cannot be written now; empty if it can."""
        return self._interruptions[name].why if name in self._interruptions else ""

    def counts(self) -> tuple[int, int]:
        """Return the number of open and of interrupted recordings; callable on any thread."""
        return len(self._open), len(self._interruptions)

    def open_names(self) -> list[str]:
        """Return the ids of the open recordings."""
        return sorted(name for name, recording in self._open.items() if recording.written)

    def close(self) -> None:
        """Close all recordings, so that each file has an end."""
        for recording in list(self._open.values()):
            try:
                with self._interrupted_by_disk(recording):
                    recording.sync()
                    self._settled += self._unsynced.pop(recording.name, [])
                    self._close(recording, reason=STOPPED)
            except RefusedError as refusal:
                self._log.error("cannot close", recording=recording.name, why=refusal.message)

    def _close(self, recording: Recording, *, reason: str) -> None:
        name = recording.name
        runs = self._runs.of_recording(name)
        for (rig, run), planned in runs.items():
            if planned.missing:
                self._log.warning(
                    "signal blocks are missing", recording=name, rig=rig, run=run, missing=planned.missing
                )
        recording.close(runs, reason=reason)
        # Not if closing failed: the files are then read again first.
        self._settled += self._unsynced.pop(name, [])
        del self._open[name]
        self._forget(name)
        if recording.order.ended:
            self._recently_closed.remember(name, recording.order)
        self._log.info("recording closed", recording=name, steps=recording.order.count, reason=reason)


def _check_block(block: rig_pb2.SignalBlock, *, run: str, description: rig_pb2.RigDescription | None) -> str:
    """Return the fault of a block as a sentence, or an empty string."""
    if block.run != run:
        return f"The block of run {block.run!r} came on the key of run {run!r}."
    if not (math.isfinite(block.sample_rate) and block.sample_rate > 0):
        return f"The sample rate is {block.sample_rate} Hz; it must be greater than 0."
    drives = None if description is None else len(description.drives)
    responses = None if description is None else len(description.responses)
    if description is not None and block.sample_rate != description.sample_rate:
        return f"The sample rate is {block.sample_rate} Hz; the rig's is {description.sample_rate} Hz."
    try:
        drive = from_array(block.drive, field="drive", shape=(drives, None), dtype=np.float64)
        from_array(block.response, field="response", shape=(responses, drive.shape[1]), dtype=np.float64)
    except ArrayError as error:
        return str(error)
    return ""
