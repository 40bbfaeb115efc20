"""Status of one endurance test for its clients: readable at any time, published at every change."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Final

from duralab_proto.v1 import query_pb2, sequencer_pb2

# A rig in simulation plays a hundred repeats in a second.
_SHORTEST_SECONDS: Final = 0.1
_REPEAT_SECONDS: Final = 0.5
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


class StatusBoard:
    """Status of one endurance test. The test's thread changes it; any thread may read it.

    `status`: Status at the beginning. `publish`: Called with each published status, one at a time.
    """

    def __init__(
        self,
        status: sequencer_pb2.EnduranceStatus,
        *,
        publish: Callable[[sequencer_pb2.EnduranceStatus], None],
    ) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._changed = True
        # Replaced at every change and never modified: a reader needs no lock and never waits for the bus.
        self._status = status

    def snapshot(self) -> sequencer_pb2.EnduranceStatus:
        """Return the present status; callers must not change it."""
        return self._status

    @property
    def ended(self) -> bool:
        """Whether the phase is final."""
        # Under the lock: the final status is published before the event is set, and a reader may then resume at once.
        with self._lock:
            return self._ended.is_set()

    def wait_ended(self, timeout_seconds: float) -> bool:
        """Wait for the final phase; return whether it is reached."""
        return self._ended.wait(timeout_seconds)

    def start_publishing(self) -> None:
        """Publish the status at changes and every half second, on a separate thread, until the final phase."""
        threading.Thread(target=self._publishing, name=f"endurance-status-{self._status.id}", daemon=True).start()

    def change(
        self,
        change: Callable[[sequencer_pb2.EnduranceStatus], object],
        *,
        remarks: Sequence[str] = (),
        alarms: Sequence[sequencer_pb2.EnduranceAlarm] = (),
    ) -> None:
        """Show a changed status: `change` gets a copy; remarks and alarms are added, and the last ones kept."""
        status = sequencer_pb2.EnduranceStatus()
        status.CopyFrom(self._status)
        change(status)
        if remarks:
            status.remarks.extend(remarks)
            del status.remarks[:-MOST_SHOWN]
        if alarms:
            status.alarms += len(alarms)
            status.last_alarms.extend(alarms)
            del status.last_alarms[:-MOST_SHOWN]
        with self._lock:
            if not self._ended.is_set():
                self._status, self._changed = status, True

    def final_status(
        self, phase: sequencer_pb2.EndurancePhase, activity: str, *, fault: query_pb2.Fault | None = None
    ) -> sequencer_pb2.EnduranceStatus:
        """Return the status of the end without showing it yet, because it is stored first."""
        status = sequencer_pb2.EnduranceStatus()
        status.CopyFrom(self._status)
        status.phase, status.activity, status.remaining_seconds = phase, activity, 0.0
        status.ClearField("hold")
        if fault is not None:
            status.fault.CopyFrom(fault)
        return status

    def end(self, status: sequencer_pb2.EnduranceStatus) -> None:
        """Show the final status; later changes are ignored."""
        if not is_final(status):
            raise ValueError(f"The phase {status.phase} is not final.")
        with self._lock:
            if self._ended.is_set():
                return
            self._status = status
            self._publish(status)
            self._ended.set()

    def _publishing(self) -> None:
        published = 0.0
        while not self._ended.wait(_SHORTEST_SECONDS):
            with self._lock:
                now = time.monotonic()
                if self._ended.is_set() or not (self._changed or now - published >= _REPEAT_SECONDS):
                    continue
                self._changed = False
                self._publish(self._status)
                published = now
