"""Result of a project: one row for each event, and whether all reached their targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from duralab.campaign import Event, Judgement
from duralab.display import html_table, text_table
from duralab.lab.campaign_result import CampaignResult

_COLUMNS = ("event", "rig", "starts from", "playbacks", "first error", "worst error", "best", "verdict")


@dataclass(frozen=True, eq=False)
class EventResult:
    """Result of an event.

    Parameters
    ----------
    event : Event
        Event of the project.
    result : CampaignResult or None
        Result of its campaign; None if the campaign ended early.
    started_from : str
        Name of the event whose playbacks, or only model, it started from; empty for the first on its rig.
    error : str
        Reason why there is no result; empty if there is one.
    """

    event: Event
    result: CampaignResult | None
    started_from: str = ""
    error: str = ""

    @property
    def reached(self) -> bool:
        """Whether the event's best playback is within all limits."""
        return self.result is not None and self.result.verdict.judgement is Judgement.REACHED

    @property
    def reason(self) -> str:
        """Reason why the event did not reach its target; empty if it did."""
        return "" if self.reached else self.error or (self.result.verdict.sentence if self.result is not None else "")

    @property
    def row(self) -> tuple[str, ...]:
        """Row of the event in the table."""
        about = (self.event.name, self.event.campaign.rig, self.started_from or "–")
        if self.result is None:
            return (*about, "–", "–", "–", "–", "ended early")
        table = self.result.iterations
        worst = table.judged_error.max(axis=1)
        figures = (str(len(table)), f"{worst[0]:.3f}", f"{worst[table.best]:.3f}", str(table.numbers[table.best]))
        return (*about, *figures, self.result.verdict.judgement.value)


@dataclass(frozen=True, eq=False)
class ProjectResult:
    """Result of a project; `print` shows its table.

    Parameters
    ----------
    name : str
        Name of the project.
    events : tuple of EventResult
        Results in the order in which they were made, rig by rig.
    report_path, order_path : Path or None
        Report, None if no event has a result; order file of the exported drives, None if no event reached its target.
    """

    name: str
    events: tuple[EventResult, ...]
    report_path: Path | None = None
    order_path: Path | None = None

    @property
    def reached(self) -> bool:
        """Whether every event reached its target."""
        return all(event.reached for event in self.events)

    @property
    def playbacks(self) -> int:
        """Number of playbacks of all events."""
        return sum(len(event.result.iterations) for event in self.events if event.result is not None)

    @property
    def sentence(self) -> str:
        """Result in one sentence."""
        missed = [event.event.name for event in self.events if not event.reached]
        what = f"{len(self.events) - len(missed)} of {len(self.events)} events reached their targets"
        rest = f"; not {', '.join(missed)}" if missed else ""
        rest += ", and no drives are written" if len(missed) == len(self.events) else ""
        return f"Project {self.name}: {what} in {self.playbacks} playbacks{rest}."

    def rows(self) -> tuple[Sequence[str], list[tuple[str, ...]]]:
        """Return header and rows of the table of results."""
        return _COLUMNS, [event.row for event in self.events]

    def document(self) -> dict[str, object]:
        """Return the result as a document for `--json`."""
        return {
            "project": self.name,
            "reached": self.reached,
            "sentence": self.sentence,
            "playbacks": self.playbacks,
            "events": [
                {
                    "event": event.event.name,
                    "rig": event.event.campaign.rig,
                    "started_from": event.started_from,
                    "reached": event.reached,
                    "error": event.error,
                    "reason": event.reason,
                    "recording": None if event.result is None else event.result.recording_path,
                    "worst_error": None if event.result is None else event.result.iterations.judged_error.max(axis=1),
                }
                for event in self.events
            ],
            "report": self.report_path,
            "order_file": self.order_path,
        }

    def __repr__(self) -> str:
        """Return the result as one line."""
        return f"ProjectResult({self.sentence})"

    def __str__(self) -> str:
        """Return the table and the sentence as text."""
        header, rows = self.rows()
        reasons = "".join(f"\n- {event.event.name}: {event.reason}" for event in self.events if event.reason)
        return f"{text_table(header, rows, left=3)}\n{self.sentence}{reasons}"

    def _repr_html_(self) -> str:
        header, rows = self.rows()
        return f"<p><b>{escape(self.sentence)}</b></p>{html_table(header, rows, left=3)}"
