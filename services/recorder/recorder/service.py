"""Recorder on the bus: maps queries and streams to calls of the archive, the catalogue and the live views."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any, Final, TypeVar

import structlog

from duralab_bus import Bus, Call, ConfigError, FaultError, FigureKind, Metrics, StreamItem, Subscription
from duralab_proto.keys import ANY, id_of, in_project, project_of
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import RecordingError, hash_of_blocks
from recorder.config import RecorderConfig
from recorder.format import (
    PlaybackStep,
    Step,
    checked_name,
    decode_step,
    existing_file,
    files_of,
    leaves_samples_out,
    recordings_in,
)
from recorder.live import LiveViews
from recorder.log import MEBIBYTE, Archive, Intake, Placement, exclusive_folder
from recorder.reading import describe, fits, read_part, read_steps, read_window, verify
from recorder.refused import RefusedError
from recorder.work_thread import WorkThread

NAME: Final = "recorder"
BLOCKS_WAIT_SECONDS: Final = 5.0
"""Longest wait without a new block for missing published blocks, while the bus repairs them from their spool."""

MOST_WAITING_FOR_POSES: Final = 5000
"""Number of jobs waiting for the disk from which poses are dropped: their publishers are not held up."""

_POLL_SECONDS: Final = 0.01
_SLOW_SECONDS: Final = 1.0  # Longer waits are reported to the client.
_END_SECONDS: Final = 1.0  # A service is given about 3 s to end.
_NO_LABELS: Final[tuple[str, ...]] = ()

ResultT = TypeVar("ResultT")


class RecorderService:
    """Service for one folder of recordings.

    `config`: Its `folder` exists.
    """

    def __init__(self, config: RecorderConfig) -> None:
        self._folder = config.folder
        self._archive = Archive(
            config.folder,
            split_bytes=config.split_size_mebibytes * MEBIBYTE,
            least_free_bytes=config.least_free_mebibytes * MEBIBYTE,
        )
        self._intake = Intake()
        self._missing_blocks = 0
        # Last playback of each recording whose missing blocks did not arrive in time.
        self._given_up: dict[str, tuple[str, str, int]] = {}
        self._marking: dict[type[Any], Subscription[Any]] = {}
        self._writer = WorkThread("recorder-writer", regularly=self._make_safe)
        self._views: LiveViews | None = None
        if config.live_file or config.viewer is not None:
            self._views = LiveViews(config.folder, files=config.live_file, viewer=config.viewer)
        self._log = structlog.get_logger(NAME)
        self._on_writer(self._archive.recover)

    def attach(self, bus: Bus) -> None:
        """Serve the recorder's keys and follow the streams."""
        keys = bus.keys
        self._register_metrics(bus.metrics)
        self._marking = {
            rig_pb2.SignalBlock: bus.subscribe(
                keys.rig_signal(ANY, ANY), rig_pb2.SignalBlock, self._taking(self._take_block), repair=True
            ),
            rig_pb2.RigState: bus.subscribe(
                keys.rig_state(ANY), rig_pb2.RigState, self._taking(self._take_state), repair=True
            ),
            iterator_pb2.CampaignEvent: bus.subscribe(
                keys.campaign_event(ANY), iterator_pb2.CampaignEvent, self._taking(self._take_event), repair=True
            ),
        }
        # Without repair: a view may lack some poses.
        bus.subscribe(keys.rig_pose(ANY), rig_pb2.PoseBlock, self._on_pose)
        # Separate workers: reading recordings does not hold up a campaign.
        bus.serve(keys.commit(), recorder_pb2.CommitRequest, _granting(partial(self.commit, bus)), workers=4)
        bus.serve(keys.recordings(), recorder_pb2.ListRecordingsRequest, _granting(self.list_recordings))
        bus.serve(
            keys.project_recordings(ANY), recorder_pb2.ListRecordingsRequest, _granting(self.list_project_recordings)
        )
        bus.serve(keys.recording(ANY), recorder_pb2.RecordingRequest, _granting(self.recording))
        bus.serve(keys.recording_read(ANY), recorder_pb2.ReadRecordingRequest, _granting(self.read))
        bus.serve(keys.recording_steps(ANY), recorder_pb2.ReadStepsRequest, _granting(self.steps))
        bus.serve(keys.recording_signals(ANY), recorder_pb2.SignalWindowRequest, _granting(self.signals))
        bus.serve(keys.recording_verify(ANY), recorder_pb2.VerifyRecordingRequest, _granting(self.verify))

    def _register_metrics(self, metrics: Metrics) -> None:
        """Register the recorder's metrics; all of them may be read on any thread."""
        readings: tuple[tuple[str, str, Callable[[], float]], ...] = (
            ("waiting_jobs", "Jobs that wait for the writer's thread", lambda: self._writer.waiting),
            ("intake_bytes", "Data received that are not on the disk yet", lambda: self._intake.bytes),
            ("lag_seconds", "Time that the oldest of these data have waited", lambda: self._intake.lag_seconds),
            ("open_recordings", "Recordings that are written", lambda: self._archive.counts()[0]),
            ("interrupted_recordings", "Recordings whose disk takes nothing", lambda: self._archive.counts()[1]),
            ("free_bytes", "Room on the disk of the recordings", lambda: shutil.disk_usage(self._folder).free),
        )
        for name, what, read in readings:
            metrics.follow(f"duralab_recorder_{name}", what, lambda read=read: {_NO_LABELS: float(read())})
        metrics.follow(
            "duralab_recorder_missing_blocks_total",
            "Signal blocks that no recording got",
            lambda: {_NO_LABELS: float(self._missing_blocks)},
            kind=FigureKind.COUNTER,
        )

    def close(self) -> None:
        """Close all recordings and views."""
        self._intake.close()
        self._writer.offer(self._close_archive)
        if not self._writer.close(_END_SECONDS):
            self._log.error("The writer did not end in time; open recordings may lack their index.")
        if self._views is not None:
            self._views.close(_END_SECONDS)

    def _close_archive(self) -> None:
        self._archive.close()
        self._mark()

    def commit(self, bus: Bus, request: recorder_pb2.CommitRequest, call: Call) -> recorder_pb2.CommitAck:
        """Store a step; the answer states that it is on the disk."""
        name = checked_name(request.recording, field="recording")
        step = decode_step(request)
        samples_hash = ""
        if isinstance(step.message, recorder_pb2.RunPlayed):
            self._await_blocks(bus, name, step.message, call)
        elif leaves_samples_out(step.message):
            samples_hash = self._hash_of_run(bus, name, step.message, call)
        self._on_writer(lambda: self._store(name, step, samples_hash), call)
        if isinstance(step.message, recorder_pb2.RecordingClosed):
            self._given_up.pop(name, None)
            # Also for a step stored before: the disk may have refused the end of the file then.
            if self._views:
                self._views.finish(name)
        return recorder_pb2.CommitAck(recording=name, step=step.number, payload_hash=step.payload_hash)

    def list_recordings(self, request: recorder_pb2.ListRecordingsRequest, call: Call) -> recorder_pb2.RecordingList:
        """Describe the recordings of the folder that match the search, without their files' hashes."""
        return self._listed(recordings_in(self._folder), request, call)

    def list_project_recordings(
        self, request: recorder_pb2.ListRecordingsRequest, call: Call
    ) -> recorder_pb2.RecordingList:
        """Describe the matching recordings of one project."""
        project = project_of(call.key)
        return self._listed((name for name in recordings_in(self._folder) if in_project(name, project)), request, call)

    def _listed(
        self, names: Iterable[str], request: recorder_pb2.ListRecordingsRequest, call: Call
    ) -> recorder_pb2.RecordingList:
        found = (self._described_if_there(name, call) for name in names)
        return recorder_pb2.RecordingList(recordings=[one for one in found if one is not None and fits(one, request)])

    def recording(self, request: recorder_pb2.RecordingRequest, call: Call) -> recorder_pb2.RecordingInfo:
        """Describe one recording."""
        del request
        return self._describe(_name_in(call.key), call)

    def read(self, request: recorder_pb2.ReadRecordingRequest, call: Call) -> recorder_pb2.RecordingPart:
        """Read a piece of a closed recording's file."""
        name = _name_in(call.key)
        self._refuse_open(name, call)
        return read_part(self._folder, name, request)

    def steps(self, request: recorder_pb2.ReadStepsRequest, call: Call) -> recorder_pb2.RecordedSteps:
        """Read the committed steps of a recording, also while it is written."""
        name = _name_in(call.key)
        information = self._on_writer(lambda: self._archive.information(name), call)
        existing_file(self._folder, name)
        written = None if information is None else information.steps
        return read_steps(files_of(self._folder, name), request, written=written)

    def signals(self, request: recorder_pb2.SignalWindowRequest, call: Call) -> recorder_pb2.SignalWindow:
        """Read a part of a run's signals."""
        name = _name_in(call.key)
        existing_file(self._folder, name)
        self._refuse_open(name, call)
        return read_window(self._folder, name, request)

    def verify(self, request: recorder_pb2.VerifyRecordingRequest, call: Call) -> recorder_pb2.VerifyResult:
        """Read a closed recording from end to end and report its errors."""
        del request
        name = _name_in(call.key)
        self._refuse_open(name, call)
        return verify(self._folder, name)

    def _describe(self, name: str, call: Call, *, hashed: bool = True) -> recorder_pb2.RecordingInfo:
        archive = self._archive
        while True:
            written, waiting = self._on_writer(lambda: (archive.information(name), archive.waiting(name)), call)
            existing_file(self._folder, name)
            information = describe(self._folder, name, written=written, waiting=waiting, hashed=hashed)
            # Repeat if its writing began meanwhile: its file without an end is then not abandoned.
            if written is not None or name not in self._on_writer(archive.open_names, call):
                return information

    def _described_if_there(self, name: str, call: Call) -> recorder_pb2.RecordingInfo | None:
        """Describe a recording without hashes (1000 are 100 GB); a missing or unreadable one hides no other."""
        try:
            return self._describe(name, call, hashed=False)
        except (OSError, IndexError, RefusedError) as error:
            if not files_of(self._folder, name):
                return None
            if not isinstance(error, OSError):
                raise
            return recorder_pb2.RecordingInfo(recording=name, waiting=f"It cannot be read: {error.strerror or error}.")

    def _refuse_open(self, name: str, call: Call) -> None:
        if name in self._on_writer(self._archive.open_names, call):
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {name!r} is still written; ask again when it is closed.",
                field="recording",
            )

    def _hash_of_run(self, bus: Bus, name: str, step: PlaybackStep, call: Call) -> str:
        """Return the hash of a run's samples on the disk; empty if they are not complete."""
        self._on_writer(lambda: self._archive.go_on(name), call)
        rig = self._on_writer(lambda: self._archive.rig_of(name, step.run), call)
        if not rig:
            return ""
        played = recorder_pb2.RunPlayed(run=step.run, rig=rig, epoch=step.signal_epoch, blocks=step.signal_blocks)
        if not self._await_blocks(bus, name, played, call):
            return ""
        topic = bus.keys.rig_signal(rig, step.run)
        try:
            places = self._on_writer(lambda: self._archive.places(name, topic, epoch=step.signal_epoch), call)
            return hash_of_blocks(places)
        except RecordingError as error:
            self._log.warning("signal blocks cannot be read back", recording=name, run=step.run, why=str(error))
            return ""

    def _await_blocks(self, bus: Bus, name: str, played: recorder_pb2.RunPlayed, call: Call) -> bool:
        """Wait until every block of a playback is stored, and return whether it is.

        The bus repairs missing blocks for a bounded time, once for each playback.
        """
        wanted = (played.rig, played.run, played.epoch)
        self._marking[rig_pb2.SignalBlock].expect(
            bus.keys.rig_signal(played.rig, played.run), played.epoch, played.blocks
        )
        fewest = played.blocks + 1
        deadline = 0.0
        while gaps := self._on_writer(lambda: self._archive.gaps(name, played), call):
            missing = sum(len(gap) for gap in gaps)
            now = time.monotonic()
            if missing < fewest:
                fewest, deadline = missing, now + BLOCKS_WAIT_SECONDS
            if wanted == self._given_up.get(name):
                return False
            if call.cancelled:
                # Neither given up nor stored: a step sent again waits for its blocks again.
                raise RefusedError(
                    query_pb2.FAULT_CODE_CANCELLED,
                    f"The client stopped waiting while {missing} signal blocks were missing.",
                )
            if now >= deadline:
                self._given_up[name] = wanted
                self._log.warning(
                    "signal blocks are missing",
                    recording=name,
                    rig=played.rig,
                    run=played.run,
                    missing=missing,
                    blocks=played.blocks,
                )
                self._missing_blocks += missing
                return False
            call.progress("waiting for signal blocks", max(0.0, 1.0 - missing / played.blocks))
            time.sleep(_POLL_SECONDS)
        return True

    def _store(self, name: str, step: Step, samples_hash: str) -> None:
        """Store a step and draw it, on the writer's thread, so that the view has the order of the log."""
        if self._archive.commit(name, step, samples_hash=samples_hash) is Placement.NEW and self._views is not None:
            self._views.show_step(name, step.message)

    def _taking(self, take: Callable[[StreamItem[Any]], object]) -> Callable[[StreamItem[Any]], None]:
        """Return the callback of a subscription: it waits while too much data is not yet on the disk."""

        def on_item(item: StreamItem[Any]) -> None:
            self._intake.admit(item)
            self._writer.offer(lambda: self._take(take, item))

        return on_item

    def _take(self, take: Callable[[StreamItem[Any]], object], item: StreamItem[Any]) -> None:
        try:
            take(item)
        except Exception as error:
            # Its publisher keeps it until it is acknowledged.
            self._archive.settle(item)
            # Any client may publish on a key that is not in the contract, e.g. iterator/event/start.
            if not isinstance(error, ValueError):
                raise
            self._log.warning("a stream message is refused", key=item.key, why=str(error))

    def _take_block(self, item: StreamItem[rig_pb2.SignalBlock]) -> None:
        recording = self._archive.take_block(item)
        if recording is not None and self._views is not None:
            self._views.show_block(recording, item.message)

    def _take_state(self, item: StreamItem[rig_pb2.RigState]) -> None:
        for recording in self._archive.take_state(item):
            if self._views is not None:
                self._views.show_state(recording, item.message)

    def _take_event(self, item: StreamItem[iterator_pb2.CampaignEvent]) -> None:
        recording = self._archive.take_event(item)
        if recording is not None and self._views is not None:
            self._views.show_status(recording, item.message)

    def _on_pose(self, item: StreamItem[rig_pb2.PoseBlock]) -> None:
        self._writer.offer(lambda: self._take_pose(item), most_waiting=MOST_WAITING_FOR_POSES)

    def _take_pose(self, item: StreamItem[rig_pb2.PoseBlock]) -> None:
        recording = self._archive.take_pose(item)
        if recording is not None and self._views is not None:
            self._views.show_pose(recording, item.message)

    def _make_safe(self) -> None:
        """Flush to disk and acknowledge to the publishers."""
        self._archive.sync()
        self._mark()

    def _mark(self) -> None:
        settled = self._archive.take_settled()
        self._intake.settle(settled)
        for kind, subscription in self._marking.items():
            # Also an empty list: it identifies the subscriber that stores, which releases a stream of refused messages.
            subscription.mark([item.position for item in settled if isinstance(item.message, kind)])

    def _on_writer(self, job: Callable[[], ResultT], call: Call | None = None) -> ResultT:
        """Run a job on the writer's thread and wait for it; a slow disk is reported to the client."""
        future = self._writer.call(job)
        while True:
            try:
                return future.result(None if call is None else _SLOW_SECONDS)
            except TimeoutError:
                if future.done():
                    raise
                if call is not None:
                    call.progress("waiting for the recorder's disk", 0.0)
            except CancelledError as error:
                ending = "The recorder is ending; start it again."
                raise RefusedError(query_pb2.FAULT_CODE_UNAVAILABLE, ending) from error


RequestT = TypeVar("RequestT")


def _granting(handler: Callable[[RequestT, Call], ResultT]) -> Callable[[RequestT, Call], ResultT]:
    """Return the handler with refusals converted to the bus's faults."""

    def handle(request: RequestT, call: Call) -> ResultT:
        try:
            return handler(request, call)
        except RefusedError as refusal:
            raise FaultError(refusal.code, refusal.message, field=refusal.field) from refusal

    return handle


def _name_in(key: str) -> str:
    try:
        return checked_name(id_of(key), field="recording")
    except ValueError as error:
        raise RefusedError(query_pb2.FAULT_CODE_NOT_FOUND, str(error), field="recording") from error


def build(config: RecorderConfig) -> Callable[[Bus], AbstractContextManager[object]]:
    """Return a function that starts the recorder on a bus and closes its files at the end.

    Parameters
    ----------
    config : RecorderConfig
        Checked configuration.

    Returns
    -------
    callable
        Takes the bus; returns the context of the running service.

    Raises
    ------
    ConfigError
        On entering the context: the folder cannot be written, or the lab or the folder already has a recorder.
    """

    @contextmanager
    def serve(bus: Bus) -> Iterator[RecorderService]:
        # A second recorder would acknowledge messages that only the first one can assign to a recording.
        if not config.new_lab and bus.discover(NAME):
            raise ConfigError(f"Another recorder is on the bus of lab {bus.config.lab!r}; end it first.")
        with exclusive_folder(config.folder):
            service = RecorderService(config)
            try:
                service.attach(bus)
                yield service
            finally:
                service.close()

    return serve
