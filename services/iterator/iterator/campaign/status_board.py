"""Status of one campaign for its clients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from duralab_bus import StatusBoard
from duralab_proto.v1 import iterator_pb2, query_pb2
from iterator.campaign.progress_estimate import Progress

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


class CampaignBoard(StatusBoard[iterator_pb2.CampaignStatus]):
    """Status of one campaign. The campaign's thread changes it; any thread may read it.

    `campaign`: Id of the campaign. `publish`: Called with each status; see `StatusBoard`. `remarks`: Notes for a person
    at the start, one sentence each.
    """

    def __init__(
        self, campaign: str, *, publish: Callable[[iterator_pb2.CampaignStatus], None], remarks: Sequence[str] = ()
    ) -> None:
        status = iterator_pb2.CampaignStatus(
            id=campaign,
            phase=iterator_pb2.CAMPAIGN_PHASE_CHECKING,
            activity="checking the specification",
            remaining_seconds=-1.0,
            remarks=remarks,
        )
        super().__init__(status, publish=publish, is_final=is_final)

    def show(self, activity: str, progress: Progress, *, phase: iterator_pb2.CampaignPhase | None = None) -> None:
        """Show the present activity and the progress of the campaign.

        `activity`: As text. `progress`: Progress of the whole campaign. `phase`: Unchanged if not given.
        """

        def change(status: iterator_pb2.CampaignStatus) -> None:
            status.activity = activity
            # The shown fraction never falls: a smaller estimate would only confuse.
            status.fraction = max(status.fraction, progress.fraction)
            status.remaining_seconds = progress.remaining_seconds
            if phase is not None:
                status.phase = phase

        self.change(change)

    def show_proposal(self, proposal: iterator_pb2.Proposal | None) -> None:
        """Show the open proposal; None once it is decided."""

        def change(status: iterator_pb2.CampaignStatus) -> None:
            status.ClearField("hold")
            if proposal is not None:
                status.hold.CopyFrom(proposal)

        self.change(change)

    def add_remarks(self, remarks: Sequence[str]) -> None:
        """Add remarks to the status."""
        if remarks:
            self.change(lambda status: status.remarks.extend(remarks))

    def show_first_drive(self, metrics: iterator_pb2.IterationMetrics | None) -> None:
        """Show the figures of a first drive that has a response to this target; None without one."""
        if metrics is not None:
            self.change(lambda status: status.first_drive.CopyFrom(metrics))

    def add_iteration(
        self, metrics: iterator_pb2.IterationMetrics, *, best_iteration: int, remarks: Sequence[str] = ()
    ) -> None:
        """Add the figures of a stored playback, and the remarks on it."""

        def change(status: iterator_pb2.CampaignStatus) -> None:
            status.remarks.extend(remarks)
            status.iterations.append(metrics)
            status.best_iteration = best_iteration

        self.change(change)

    def add_confirmation(
        self,
        repeatability: iterator_pb2.Repeatability | None = None,
        *,
        metrics: iterator_pb2.IterationMetrics | None = None,
        remarks: Sequence[str] = (),
    ) -> None:
        """Show the figures of a confirmation, the repeatability of the rig if known, and the remarks on it."""

        def change(status: iterator_pb2.CampaignStatus) -> None:
            status.remarks.extend(remarks)
            if metrics is not None:
                status.confirmations.append(metrics)
            if repeatability is not None:
                status.repeatability.CopyFrom(repeatability)

        self.change(change)

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
        status = self.copy()
        status.phase, status.activity, status.outcome = phase, activity, outcome
        status.remaining_seconds = 0.0
        status.ClearField("hold")
        if phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED:
            status.fraction = 1.0
        if fault is not None:
            status.fault.CopyFrom(fault)
        return status
