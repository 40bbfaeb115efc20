"""The recorder on the bus: turns queries and streams into calls of the archive, the catalogue and the live views."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final, TypeVar

import structlog

from duralab_proto.keys import ANY, id_of
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from labbus import Bus, Call, ConfigError, FaultError, StreamItem
from recorder.archive import Archive
from recorder.catalogue import checked_name, describe, existing_file, read_part, recordings_in, verify
from recorder.config import RecorderConfig
from recorder.live_views import LiveViews
from recorder.mcap_audit import read_summary
from recorder.refused import RefusedError
from recorder.step_order import Placement
from recorder.step_reading import read_steps
from recorder.step_types import Step, decode_step
from recorder.work_thread import WorkThread

NAME: Final = "recorder"
BLOCKS_WAIT_SECONDS: Final = 5.0
"""Longest wait without a new one for signal blocks that were published but are not here, while they are asked for
again; on a sound bus they come within milliseconds."""

_POLL_SECONDS: Final = 0.01
# What is on its way is not asked for; what was lost is there after a first question, unless the bus is disturbed.
_REPLAY_AFTER_SECONDS: Final = 0.1
_REPLAY_PERIOD_SECONDS: Final = 0.5
# A service is given about 3 s to end.
_END_SECONDS: Final = 1.0

ResultT = TypeVar("ResultT")


class RecorderService:
    """Answers for one folder of recordings.

    Parameters
    ----------
    config : RecorderConfig
        Its `folder` exists.
    """

    def __init__(self, config: RecorderConfig) -> None:
        self._folder = config.folder
        self._archive = Archive(config.folder)
        self._writer = WorkThread("recorder-writer", regularly=self._archive.sync)
        self._views: LiveViews | None = None
        if config.live_file or config.viewer is not None:
            self._views = LiveViews(config.folder, files=config.live_file, viewer=config.viewer)
        self._log = structlog.get_logger(NAME)

    def attach(self, bus: Bus) -> None:
        """Serve the recorder's keys and follow the streams."""
        keys = bus.keys
        bus.subscribe(keys.rig_signal(ANY, ANY), rig_pb2.SignalBlock, self._on_block, repair=True)
        bus.subscribe(keys.rig_state(ANY), rig_pb2.RigState, self._on_state, repair=True)
        bus.subscribe(keys.campaign_event(ANY), iterator_pb2.CampaignEvent, self._on_event, repair=True)
        bus.serve(
            keys.commit(), recorder_pb2.CommitRequest, _granting(lambda request, call: self.commit(bus, request, call))
        )
        bus.serve(keys.recordings(), recorder_pb2.ListRecordingsRequest, _granting(self.list_recordings))
        bus.serve(keys.recording(ANY), recorder_pb2.RecordingRequest, _granting(self.recording))
        bus.serve(keys.recording_read(ANY), recorder_pb2.ReadRecordingRequest, _granting(self.read))
        bus.serve(keys.recording_steps(ANY), recorder_pb2.ReadStepsRequest, _granting(self.steps))
        bus.serve(keys.recording_verify(ANY), recorder_pb2.VerifyRecordingRequest, _granting(self.verify))

    def close(self) -> None:
        """Close all recordings and views."""
        self._writer.offer(self._archive.close)
        if not self._writer.close(_END_SECONDS):
            self._log.error("The writer did not end in time; open recordings may lack their index.")
        if self._views is not None:
            self._views.close(_END_SECONDS)

    def commit(self, bus: Bus, request: recorder_pb2.CommitRequest, call: Call) -> recorder_pb2.CommitAck:
        """Store a step; the answer says that it is on the disk."""
        name = checked_name(request.recording, field="recording")
        step = decode_step(request)
        if isinstance(step.message, recorder_pb2.RunPlayed):
            self._await_blocks(bus, name, step.message, call)
        placement = self._on_writer(lambda: self._store(name, step))
        if placement is Placement.NEW and isinstance(step.message, recorder_pb2.RecordingClosed) and self._views:
            self._views.finish(name)
        return recorder_pb2.CommitAck(recording=name, step=step.number, payload_hash=step.payload_hash)

    def list_recordings(self, request: recorder_pb2.ListRecordingsRequest, call: Call) -> recorder_pb2.RecordingList:
        """Describe every recording of the folder."""
        del request, call
        names = sorted({*recordings_in(self._folder), *self._on_writer(self._archive.open_names)})
        return recorder_pb2.RecordingList(recordings=[self._describe(name) for name in names])

    def recording(self, request: recorder_pb2.RecordingRequest, call: Call) -> recorder_pb2.RecordingInfo:
        """Describe one recording."""
        del request
        return self._describe(_name_in(call.key))

    def read(self, request: recorder_pb2.ReadRecordingRequest, call: Call) -> recorder_pb2.RecordingPart:
        """Read a piece of a closed recording's file."""
        name = _name_in(call.key)
        self._refuse_open(name)
        return read_part(self._folder, name, request)

    def steps(self, request: recorder_pb2.ReadStepsRequest, call: Call) -> recorder_pb2.RecordedSteps:
        """Read the steps that were committed to a recording, also while it is written."""
        name = _name_in(call.key)
        information = self._on_writer(lambda: self._archive.information(name))
        path = existing_file(self._folder, name)
        known = information or read_summary(path)
        return read_steps(path, request, written=None if known is None else known.steps)

    def verify(self, request: recorder_pb2.VerifyRecordingRequest, call: Call) -> recorder_pb2.VerifyResult:
        """Read a closed recording from end to end and say what is wrong with it."""
        del request
        name = _name_in(call.key)
        self._refuse_open(name)
        return verify(self._folder, name)

    def _describe(self, name: str) -> recorder_pb2.RecordingInfo:
        information = self._on_writer(lambda: self._archive.information(name))
        return describe(existing_file(self._folder, name)) if information is None else information

    def _refuse_open(self, name: str) -> None:
        if name in self._on_writer(self._archive.open_names):
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {name!r} is still written; ask again when it is closed.",
                field="recording",
            )

    def _await_blocks(self, bus: Bus, name: str, played: recorder_pb2.RunPlayed, call: Call) -> None:
        """Wait until every block of a playback is stored, and have replayed what does not come, for a bounded time."""
        key = bus.keys.rig_signal(played.rig, played.run)
        fewest = played.blocks + 1
        deadline = 0.0
        replay_at = time.monotonic() + _REPLAY_AFTER_SECONDS
        while gaps := self._on_writer(lambda: self._archive.gaps(name, played)):
            missing = sum(len(gap) for gap in gaps)
            now = time.monotonic()
            if missing < fewest:
                fewest, deadline = missing, now + BLOCKS_WAIT_SECONDS
            if now >= deadline or call.cancelled:
                self._log.warning(
                    "signal blocks are missing",
                    recording=name,
                    rig=played.rig,
                    run=played.run,
                    missing=missing,
                    blocks=played.blocks,
                )
                return
            call.progress("waiting for signal blocks", max(0.0, 1.0 - missing / played.blocks))
            if now >= replay_at:
                try:
                    for item in bus.replay(key, rig_pb2.SignalBlock, epoch=played.epoch, ranges=gaps):
                        self._on_block(item)
                except FaultError as fault:
                    self._log.warning("a replay is refused", run=played.run, why=fault.message)
                replay_at = time.monotonic() + _REPLAY_PERIOD_SECONDS
            else:
                time.sleep(_POLL_SECONDS)

    def _store(self, name: str, step: Step) -> Placement:
        """Store a step and pass it on to its view: on the writer's thread, so that the view sees the log's order."""
        placement = self._archive.commit(name, step)
        if placement is Placement.NEW and self._views is not None:
            self._views.show_step(name, step.message)
        return placement

    def _on_block(self, item: StreamItem[rig_pb2.SignalBlock]) -> None:
        self._writer.offer(lambda: self._take_block(item))

    def _take_block(self, item: StreamItem[rig_pb2.SignalBlock]) -> None:
        recording = self._archive.take_block(item)
        if recording is not None and self._views is not None:
            self._views.show_block(recording, item.message)

    def _on_state(self, item: StreamItem[rig_pb2.RigState]) -> None:
        self._writer.offer(lambda: self._archive.take_state(item))

    def _on_event(self, item: StreamItem[iterator_pb2.CampaignEvent]) -> None:
        self._writer.offer(lambda: self._take_event(item))

    def _take_event(self, item: StreamItem[iterator_pb2.CampaignEvent]) -> None:
        recording = self._archive.take_event(item)
        if recording is not None and self._views is not None:
            self._views.show_status(recording, item.message)

    def _on_writer(self, job: Callable[[], ResultT]) -> ResultT:
        try:
            return self._writer.call(job).result()
        except CancelledError as error:
            raise RefusedError(query_pb2.FAULT_CODE_UNAVAILABLE, "The recorder is ending; start it again.") from error


RequestT = TypeVar("RequestT")


def _granting(handler: Callable[[RequestT, Call], ResultT]) -> Callable[[RequestT, Call], ResultT]:
    """Return the handler with refusals answered as the bus's faults."""

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


def _prepare(folder: Path) -> None:
    """Make the folder and prove that files can be made in it."""
    probe = folder / ".writable"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ConfigError(
            f"The recorder cannot write in folder {str(folder)!r}: {error.strerror or error}; correct `folder`."
        ) from error


def build(config: RecorderConfig) -> Callable[[Bus], AbstractContextManager[object]]:
    """Return what sets the recorder up on a bus and closes its files at the end."""

    @contextmanager
    def serve(bus: Bus) -> Iterator[RecorderService]:
        _prepare(config.folder)
        service = RecorderService(config)
        try:
            service.attach(bus)
            yield service
        finally:
            service.close()

    return serve
