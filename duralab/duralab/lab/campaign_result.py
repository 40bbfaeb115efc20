"""Result of a campaign."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path

from duralab.campaign import Verdict, judge, judged_rows
from duralab.data import IterationTable, counted_slope, iterations_html
from duralab.display import html_table, text_table
from duralab.recording import Recording, open_recording
from duralab_proto.v1 import iterator_pb2


@dataclass(frozen=True, eq=False)
class CampaignResult:
    """Result of a finished campaign; `print` shows its table.

    Parameters
    ----------
    specification : CampaignSpec
        Specification that was sent to the iterator.
    status : CampaignStatus
        Last status of the campaign.
    recording_path, live_path : Path
        Paths of the recording and of the viewer's file.
    """

    specification: iterator_pb2.CampaignSpec
    status: iterator_pb2.CampaignStatus
    recording_path: Path
    live_path: Path

    @cached_property
    def iterations(self) -> IterationTable:
        """Numbers of every playback."""
        return IterationTable.from_status(self.status)

    @cached_property
    def verdict(self) -> Verdict:
        """Judgement whether the target was reached."""
        return judge(self.iterations, specification=self.specification, status=self.status)

    @cached_property
    def recording(self) -> Recording:
        """Recording, read from its file."""
        return open_recording(self.recording_path)

    def report(self, path: str | Path | None = None) -> Path:
        """Write the report, beside the recording if no path is given, and return its path.

        Parameters
        ----------
        path : str or Path, optional
            Path of the output; an existing file is replaced.

        Returns
        -------
        Path
            Path of the report.
        """
        from duralab.report import write_report

        return write_report(self.recording, path or self.recording_path.with_name("report.html"))

    def __repr__(self) -> str:
        """Return the result as one line, without arrays."""
        return f"CampaignResult({self.status.id}: {self.verdict.judgement})"

    def __str__(self) -> str:
        """Return table, verdict and remarks as text."""
        remarks = "".join(f"\n- {remark}" for remark in self.status.remarks)
        judged = text_table(*self._judged(), left=1) if len(self.iterations) else ""
        return f"{self.iterations}\n{judged}\n{self.verdict.sentence}{remarks}"

    def _repr_html_(self) -> str:
        remarks = "".join(f"<li>{escape(remark)}</li>" for remark in self.status.remarks)
        verdict = f"<p><b>{escape(self.verdict.sentence)}</b></p>"
        judged = html_table(*self._judged(), left=1) if len(self.iterations) else ""
        return f"{verdict}{judged}{iterations_html(self.iterations)}{f'<ul>{remarks}</ul>' if remarks else ''}"

    def _judged(self) -> tuple[list[str], list[list[str]]]:
        header, rows = judged_rows(self.iterations, self.verdict, slope=counted_slope(self.specification))
        return [", ".join(filter(None, heading)) for heading in header], rows
