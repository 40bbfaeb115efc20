"""Status of one endurance test for its clients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from duralab_bus import StatusBoard
from duralab_proto.v1 import query_pb2, sequencer_pb2

# A rig in simulation plays a hundred repeats in a second.
_SHORTEST_SECONDS: Final = 0.1
MOST_SHOWN: Final = 20
"""Largest number of alarms and of remarks in a status."""

_FINAL_PHASES: Final = frozenset(
    {
        sequencer_pb2.ENDURANCE_PHASE_FINISHED,
        sequencer_pb2.ENDURANCE_PHASE_FAULTED,
        sequencer_pb2.ENDURANCE_PHASE_STOPPED,
    }
)


def is_final(status: sequencer_pb2.EnduranceStatus) -> bool:
    """Return whether the test has ended."""
    return status.phase in _FINAL_PHASES


class EnduranceBoard(StatusBoard[sequencer_pb2.EnduranceStatus]):
    """Status of one endurance test. The test's thread changes it; any thread may read it.

    `status`: Status at the beginning. `publish`: Called with each published status, one at a time.
    """

    def __init__(
        self,
        status: sequencer_pb2.EnduranceStatus,
        *,
        publish: Callable[[sequencer_pb2.EnduranceStatus], None],
    ) -> None:
        super().__init__(status, publish=publish, is_final=is_final, shortest_seconds=_SHORTEST_SECONDS)

    def add_remark(self, remark: str) -> None:
        """Add a remark; the last ones are kept."""

        def change(status: sequencer_pb2.EnduranceStatus) -> None:
            status.remarks.append(remark)
            del status.remarks[:-MOST_SHOWN]

        self.change(change)

    def show_repeat(
        self,
        step: sequencer_pb2.EnduranceRepeat,
        *,
        kept: bool,
        counts: Callable[[sequencer_pb2.EnduranceStatus], None],
    ) -> None:
        """Show a stored repeat, and whether its samples are kept; count its alarms and keep the last ones.

        `counts`: Changes the numbers of repeats and the damage, at the same moment.
        """

        def change(status: sequencer_pb2.EnduranceStatus) -> None:
            counts(status)
            status.last_repeat, status.last_event, status.kept = step.repeat, step.event, status.kept + kept
            status.last_statistics.CopyFrom(step.statistics)
            status.alarms += len(step.alarms)
            status.last_alarms.extend(step.alarms)
            del status.last_alarms[:-MOST_SHOWN]

        self.change(change)

    def final_status(
        self, phase: sequencer_pb2.EndurancePhase, activity: str, *, fault: query_pb2.Fault | None = None
    ) -> sequencer_pb2.EnduranceStatus:
        """Return the status of the end without showing it yet, because it is stored first."""
        status = self.copy()
        status.phase, status.activity, status.remaining_seconds = phase, activity, 0.0
        status.ClearField("hold")
        if fault is not None:
            status.fault.CopyFrom(fault)
        return status
