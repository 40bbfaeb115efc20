"""All open recordings of a folder: commits, streams and closing. Used by one thread, which is the log's only writer."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any, Final

import structlog

from duralab_proto.keys import id_of, rig_of, run_of
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from labbus import StreamItem
from recorder.catalogue import recording_path
from recorder.recording import Recording
from recorder.refused import RefusedError
from recorder.run_book import RunBook
from recorder.signal_check import check_block
from recorder.step_order import Placement, StepOrder
from recorder.step_types import Step

STOPPED: Final = "the recorder was stopped"


class Archive:
    """The recordings that are written now.

    Parameters
    ----------
    folder : Path
        Where the files go; it exists.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: dict[str, Recording] = {}
        # What was closed by this process: a last step that is sent again is still acknowledged.
        self._closed: dict[str, StepOrder] = {}
        self._runs = RunBook()
        self._descriptions: dict[tuple[str, str], rig_pb2.RigDescription] = {}
        # Told once each; bounded, because anybody may play by hand for as long as the lab runs.
        self._foreign_runs: deque[str] = deque(maxlen=100)
        self._unwritable: set[str] = set()
        self._log = structlog.get_logger("recorder")

    def commit(self, name: str, step: Step) -> Placement:
        """Store a step and return when it is on the disk, or find that it is there already.

        Parameters
        ----------
        name : str
            Id of the recording, checked; its first step makes it.
        step : Step
            Decoded and checked.

        Raises
        ------
        RefusedError
            The step does not follow, or the disk refuses it.
        """
        if name in self._closed:
            return self._closed[name].place(step)
        recording = self._open.get(name)
        placement = StepOrder(name).place(step) if recording is None else recording.place(step)
        if placement is Placement.STORED:
            return placement
        if isinstance(step.message, recorder_pb2.RunPlanned | recorder_pb2.RunPlayed):
            self._runs.check(step.message, name)
        if recording is None:
            # Only now, when nothing but the disk can refuse it: a refused first step leaves no file.
            recording = self._create(name)
        self._store(recording, step)
        self._note(recording, step)
        return placement

    def _create(self, name: str) -> Recording:
        path = recording_path(self._folder, name)
        try:
            recording = Recording(name, path)
        except FileExistsError as error:
            raise RefusedError(
                query_pb2.FAULT_CODE_ALREADY_EXISTS,
                f"There is a recording {name!r} from before ({path.name}); choose another id.",
                field="recording",
            ) from error
        except OSError as error:
            raise RefusedError(
                query_pb2.FAULT_CODE_INTERNAL,
                f"The file {path.name} of recording {name!r} cannot be created: {error.strerror or error}; "
                "see to the recorder's folder.",
                field="recording",
            ) from error
        self._open[name] = recording
        self._log.info("recording opened", recording=name, file=path.name)
        return recording

    def _store(self, recording: Recording, step: Step) -> None:
        try:
            recording.store(step)
        except RefusedError:
            if recording.order.count == 0:
                del self._open[recording.name]
                recording.abandon()
            raise

    def _note(self, recording: Recording, step: Step) -> None:
        """Do what follows from a step that is on the disk."""
        name, message = recording.name, step.message
        match message:
            case recorder_pb2.RunPlanned() | recorder_pb2.RunPlayed():
                self._runs.note(message, name)
            case rig_pb2.RigDescription():
                self._descriptions[name, message.rig] = message
            case recorder_pb2.RecordingClosed():
                self._close(recording, reason=message.reason)

    def missing_blocks(self, name: str, played: recorder_pb2.RunPlayed) -> int:
        """Count which blocks of a playback are not stored; 0 where it was not announced to this recording."""
        return sum(len(gap) for gap in self.gaps(name, played))

    def gaps(self, name: str, played: recorder_pb2.RunPlayed) -> list[range]:
        """Return which blocks of a playback are not stored; none where it was not announced to this recording."""
        run = self._runs.find(played.rig, played.run)
        if run is None or run.recording != name:
            return []
        return run.gaps_of(played.epoch, played.blocks)

    def take_block(self, item: StreamItem[rig_pb2.SignalBlock]) -> str | None:
        """Write a signal block; return the recording it went to, or None where it belongs to none."""
        rig, name = rig_of(item.key), run_of(item.key)
        run = self._runs.find(rig, name)
        if run is None:
            if name not in self._foreign_runs:
                self._foreign_runs.append(name)
                self._log.info("a run of no recording is not kept", run=name, rig=rig)
            return None
        if not self._runs.is_new(run, item.epoch, item.seq):
            return None
        fault = check_block(item.message, run=name, description=self._descriptions.get((run.recording, rig)))
        if fault:
            self._log.warning("a signal block is refused", run=name, rig=rig, seq=item.seq, why=fault)
            return None
        if not self._add_stream(run.recording, item):
            return None
        self._runs.accept(run, item.epoch, item.seq)
        return run.recording

    def take_state(self, item: StreamItem[rig_pb2.RigState]) -> None:
        """Write a rig's state to the recordings that have a playback on it."""
        for name in self._runs.recordings_of_rig(rig_of(item.key)):
            self._add_stream(name, item)

    def take_event(self, item: StreamItem[iterator_pb2.CampaignEvent]) -> str | None:
        """Write a campaign's event to its recording; return its id, or None where it is not open."""
        name = id_of(item.key)
        if name not in self._open or item.message.status.id != name:
            return None
        return name if self._add_stream(name, item) else None

    def _add_stream(self, name: str, item: StreamItem[Any]) -> bool:
        """Write a stream message; a disk that refuses it is told of once here, and at the recording's next commit."""
        try:
            self._open[name].add_stream(item.key, item.message, epoch=item.epoch, seq=item.seq)
        except RefusedError as refusal:
            if name not in self._unwritable:
                self._unwritable.add(name)
                self._log.error("streams are lost", recording=name, why=refusal.message)
            return False
        return True

    def information(self, name: str) -> recorder_pb2.RecordingInfo | None:
        """Return the description of a recording that is written now, or None."""
        recording = self._open.get(name)
        return None if recording is None else recording.information(self._runs.of_recording(name))

    def open_names(self) -> list[str]:
        """Return the ids of the recordings that are written now."""
        return sorted(self._open)

    def sync(self) -> None:
        """Bring everything to the disk; a recording that fails says so at its next commit."""
        for recording in self._open.values():
            try:
                recording.sync()
            except RefusedError as refusal:
                if recording.name not in self._unwritable:
                    self._unwritable.add(recording.name)
                    self._log.error("cannot write", recording=recording.name, why=refusal.message)

    def close(self) -> None:
        """Close all recordings, so that each file is complete as far as it goes."""
        for recording in list(self._open.values()):
            try:
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
        del self._open[name]
        self._runs.forget(name)
        self._descriptions = {key: value for key, value in self._descriptions.items() if key[0] != name}
        recording.close(runs, reason=reason)
        # Not where closing failed: the last step, sent again, must then not be acknowledged.
        self._closed[name] = recording.order
        self._log.info("recording closed", recording=name, steps=recording.order.count, reason=reason)
