"""Which recording each playback belongs to, and which of its signal blocks are stored."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from duralab_bus import Continuity
from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.format import MOST_BLOCKS, PlannedRun
from recorder.refused import RefusedError


class RunRegistry:
    """The playbacks of all open recordings, by rig and run."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str], PlannedRun] = {}
        # Bounded, because anybody may play by hand for as long as the lab runs.
        self._strangers: deque[str] = deque(maxlen=100)

    def find(self, rig: str, run: str) -> PlannedRun | None:
        """Return a playback that was announced, or None."""
        return self._runs.get((rig, run))

    def rig_of(self, recording: str, run: str) -> str:
        """Return the rig that a run was announced on to a recording; empty where it was not."""
        return next((rig for rig, name in self.of_recording(recording) if name == run), "")

    def is_new_stranger(self, run: str) -> bool:
        """Whether a run of no recording is met for the first time."""
        if run in self._strangers:
            return False
        self._strangers.append(run)
        return True

    def check(self, message: recorder_pb2.RunPlanned | recorder_pb2.RunPlayed, recording: str) -> None:
        """Raise a RefusedError where the announcement does not fit to what was announced before."""
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
        run = self._runs.setdefault((message.rig, message.run), PlannedRun(recording))
        if isinstance(message, recorder_pb2.RunPlayed):
            run.played = message

    def is_new(self, run: PlannedRun, epoch: int, seq: int) -> bool:
        """Tell whether a block is to be stored: it was not before, and its number is a possible one."""
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
        """Take over the playbacks of a recording as its files hold them."""
        self._runs.update(runs)

    def forget(self, recording: str) -> None:
        """Drop the playbacks of a recording that is closed or read again."""
        for key in self.of_recording(recording):
            del self._runs[key]
