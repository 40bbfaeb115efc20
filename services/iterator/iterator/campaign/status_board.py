"""Status of one campaign for its clients: readable at any time, published at every change and repeated."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Final

from duralab_proto.v1 import iterator_pb2, query_pb2
from iterator.campaign.progress_estimate import Progress

_REPEAT_SECONDS: Final = 0.5
_FINAL_PHASES: Final = frozenset(
    {
        iterator_pb2.CAMPAIGN_PHASE_FINISHED,
        iterator_pb2.CAMPAIGN_PHASE_FAULTED,
        iterator_pb2.CAMPAIGN_PHASE_STOPPED,
    }
)


def is_final(status: iterator_pb2.CampaignStatus) -> bool:
    """Return whether the campaign has ended.

    `status`: Status of the campaign.
    Returns: True if it finished, failed or was stopped.
    """
    return status.phase in _FINAL_PHASES


class StatusBoard:
    """Status of one campaign. The campaign's thread changes it; any thread may read it.

    `campaign`: Id of the campaign. `publish`: Called with each CampaignStatus, one at a time, in order, until the final
    phase; it must not change the status. `remarks`: Notes for a person at the start, one sentence each.
    """

    def __init__(
        self, campaign: str, *, publish: Callable[[iterator_pb2.CampaignStatus], None], remarks: Sequence[str] = ()
    ) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._published_at = 0.0
        # Replaced at every change and never modified: a reader needs no lock and never waits for the bus.
        self._status = iterator_pb2.CampaignStatus(
            id=campaign,
            phase=iterator_pb2.CAMPAIGN_PHASE_CHECKING,
            activity="checking the specification",
            remaining_seconds=-1.0,
            remarks=remarks,
        )

    def snapshot(self) -> iterator_pb2.CampaignStatus:
        """Return the status now."""
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

    def start_repeating(self) -> None:
        """Publish the status again while it does not change, on a separate thread, until the final phase."""
        threading.Thread(target=self._repeat, name=f"campaign-status-{self._status.id}", daemon=True).start()

    def show(self, activity: str, progress: Progress, *, phase: iterator_pb2.CampaignPhase | None = None) -> None:
        """Show the present activity and the progress of the campaign.

        `activity`: As text. `progress`: Progress of the whole campaign. `phase`: Unchanged if not given.
        """
        with self._lock:
            status = self._copy()
            status.activity = activity
            # The shown fraction never falls: a smaller estimate would only confuse.
            status.fraction = max(status.fraction, progress.fraction)
            status.remaining_seconds = progress.remaining_seconds
            if phase is not None:
                status.phase = phase
            self._replace(status)

    def show_proposal(self, proposal: iterator_pb2.Proposal | None) -> None:
        """Show the open proposal; None once it is decided."""
        with self._lock:
            status = self._copy()
            status.ClearField("hold")
            if proposal is not None:
                status.hold.CopyFrom(proposal)
            self._replace(status)

    def add_remarks(self, remarks: Sequence[str]) -> None:
        """Add remarks to the status."""
        if remarks:
            with self._lock:
                status = self._copy()
                status.remarks.extend(remarks)
                self._replace(status)

    def add_iteration(
        self, metrics: iterator_pb2.IterationMetrics, *, best_iteration: int, remarks: Sequence[str] = ()
    ) -> None:
        """Add the figures of a stored playback, and the remarks on it."""
        with self._lock:
            status = self._copy()
            status.remarks.extend(remarks)
            status.iterations.append(metrics)
            status.best_iteration = best_iteration
            self._replace(status)

    def add_confirmation(
        self,
        repeatability: iterator_pb2.Repeatability | None = None,
        *,
        metrics: iterator_pb2.IterationMetrics | None = None,
        remarks: Sequence[str] = (),
    ) -> None:
        """Show the figures of a confirmation, the repeatability of the rig if known, and the remarks on it."""
        with self._lock:
            status = self._copy()
            status.remarks.extend(remarks)
            if metrics is not None:
                status.confirmations.append(metrics)
            if repeatability is not None:
                status.repeatability.CopyFrom(repeatability)
            self._replace(status)

    def final_status(
        self,
        phase: iterator_pb2.CampaignPhase,
        activity: str,
        *,
        outcome: iterator_pb2.Outcome = iterator_pb2.OUTCOME_UNSPECIFIED,
        fault: query_pb2.Fault | None = None,
    ) -> iterator_pb2.CampaignStatus:
        """Return the status of the end without showing it yet, because it is stored first.

        `phase`: FINISHED, FAULTED or STOPPED. `activity`: Kind of the end, as text. `outcome`: Outcome of a finished
        campaign. `fault`: Fault of an unfinished campaign.
        """
        status = self._copy()
        status.phase, status.activity, status.outcome = phase, activity, outcome
        status.remaining_seconds = 0.0
        status.ClearField("hold")
        if phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED:
            status.fraction = 1.0
        if fault is not None:
            status.fault.CopyFrom(fault)
        return status

    def end(self, status: iterator_pb2.CampaignStatus) -> None:
        """Show the final status; later changes are ignored."""
        if not is_final(status):
            raise ValueError(f"The phase {status.phase} is not final.")
        with self._lock:
            self._replace(status)
            self._ended.set()

    def _copy(self) -> iterator_pb2.CampaignStatus:
        status = iterator_pb2.CampaignStatus()
        status.CopyFrom(self._status)
        return status

    def _replace(self, status: iterator_pb2.CampaignStatus) -> None:
        """Show a new status; the caller holds the lock."""
        if self._ended.is_set():
            return
        self._status = status
        self._publish(status)
        self._published_at = time.monotonic()

    def _repeat(self) -> None:
        while not self._ended.wait(_REPEAT_SECONDS / 2.0):
            with self._lock:
                if not self._ended.is_set() and time.monotonic() - self._published_at >= _REPEAT_SECONDS:
                    self._publish(self._status)
                    self._published_at = time.monotonic()
