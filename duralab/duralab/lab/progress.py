"""Progress of a campaign until its end: events, and a query after a silence in case an event was lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from duralab.data import IterationTable, Proposal
from duralab_proto.v1 import iterator_pb2

POLL_SECONDS: Final = 1.0
"""Silence after which the iterator is queried."""

ENDED: Final = frozenset(
    {
        iterator_pb2.CAMPAIGN_PHASE_FINISHED,
        iterator_pb2.CAMPAIGN_PHASE_FAULTED,
        iterator_pb2.CAMPAIGN_PHASE_STOPPED,
    }
)


class Stage(StrEnum):
    """Stage of a run."""

    TARGET = "target"
    CAMPAIGN = "campaign"
    IDENTIFICATION = "identification"
    PLAYBACK = "playback"
    PRE_TEST = "pre-test"


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run.

    Parameters
    ----------
    stage : Stage
        Stage of the run.
    activity : str
        Present activity as text.
    fraction : float
        Completed share of the stage, 0 to 1.
    remaining_seconds : float
        Expected time to the stage's end; negative if unknown.
    iterations : IterationTable or None
        Numbers of the completed playbacks; None before the first.
    hold : Proposal or None
        Proposal on which the campaign waits for a decision, without samples; None if it does not wait.
    campaign : str
        Id of the campaign; empty for other runs.
    lasting : bool
        True if the activity is a sentence that stays in view, such as a warning.
    """

    stage: Stage
    activity: str
    fraction: float
    remaining_seconds: float
    iterations: IterationTable | None = None
    hold: Proposal | None = None
    campaign: str = ""
    lasting: bool = False

    def __str__(self) -> str:
        """Return a description as text."""
        left = f", {self.remaining_seconds:.0f} s left" if self.remaining_seconds >= 0 else ""
        return f"{self.stage}: {self.activity} ({100 * self.fraction:.0f} %{left})"


OnProgress = Callable[[RunProgress], None]


def progress_of(status: iterator_pb2.CampaignStatus) -> RunProgress:
    """Return the progress of a campaign."""
    return RunProgress(
        stage=Stage.CAMPAIGN,
        activity=status.activity,
        fraction=status.fraction,
        remaining_seconds=status.remaining_seconds,
        iterations=IterationTable.from_status(status) if status.iterations else None,
        hold=Proposal.from_message(status.hold) if status.HasField("hold") else None,
        campaign=status.id,
    )
