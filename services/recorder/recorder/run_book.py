"""Which recording each playback belongs to, and which of its signal blocks are stored."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from duralab_proto.v1 import query_pb2, recorder_pb2
from labbus import Continuity
from recorder.refused import RefusedError

MOST_BLOCKS: Final = 2**32
"""Of one playback: the log keeps 32 bits of a sequence number."""


def ranges_of(continuity: Continuity) -> list[range]:
    """Return what was received, as ascending ranges that do not touch."""
    edges = [0]
    for gap in continuity.missing(continuity.next_seq):
        edges += [gap.start, gap.stop]
    edges.append(continuity.next_seq)
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [range(first, stop) for first, stop in pairs if first < stop]


@dataclass
class PlannedRun:
    """A playback that was announced.

    Parameters
    ----------
    recording : str
        Where its blocks go.
    """

    recording: str
    played: recorder_pb2.RunPlayed | None = None
    # One count for each publisher: a playback that is repeated after a fault has a new epoch.
    epochs: dict[int, Continuity] = field(default_factory=dict)

    @property
    def stored(self) -> int:
        """Number of different blocks stored."""
        return sum(continuity.received for continuity in self.epochs.values())

    @property
    def missing(self) -> int:
        """Number of blocks known to be missing: of all that were announced, or else the gaps seen so far."""
        if self.played is not None:
            return self.missing_of(self.played.epoch, self.played.blocks)
        return sum(continuity.next_seq - continuity.received for continuity in self.epochs.values())

    def stored_ranges(self) -> dict[int, list[range]]:
        """Return which blocks are stored, for each epoch, as ascending ranges that do not touch."""
        return {epoch: ranges_of(continuity) for epoch, continuity in self.epochs.items()}

    def missing_of(self, epoch: int, blocks: int) -> int:
        """Count which of the first `blocks` blocks of an epoch are not stored."""
        return sum(len(gap) for gap in self.gaps_of(epoch, blocks))

    def gaps_of(self, epoch: int, blocks: int) -> list[range]:
        """Return which of the first `blocks` blocks of an epoch are not stored."""
        return self.epochs.get(epoch, Continuity()).missing(blocks)


class RunBook:
    """The playbacks of all open recordings, by rig and run."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str], PlannedRun] = {}
        # Bounded, because anybody may play by hand for as long as the lab runs.
        self._strangers: deque[str] = deque(maxlen=100)

    def find(self, rig: str, run: str) -> PlannedRun | None:
        """Return a playback that was announced, or None."""
        return self._runs.get((rig, run))

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
