"""What a campaign came to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from duralab.iteration_table import IterationTable
from duralab.recording import Recording, open_recording
from duralab.verdict import Verdict, judge
from duralab_proto.v1 import iterator_pb2


@dataclass(frozen=True, eq=False)
class CampaignResult:
    """A finished campaign; `print` shows its table.

    Parameters
    ----------
    specification : CampaignSpec
        What was asked for.
    status : CampaignStatus
        How it ended.
    recording_path, live_path : Path
        Where the recording and what the viewer showed are.
    """

    specification: iterator_pb2.CampaignSpec
    status: iterator_pb2.CampaignStatus
    recording_path: Path
    live_path: Path

    @cached_property
    def iterations(self) -> IterationTable:
        """The figures of every playback."""
        return IterationTable.from_status(self.status)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the target was reached."""
        return judge(self.iterations, specification=self.specification, status=self.status)

    @cached_property
    def recording(self) -> Recording:
        """The recording, read from its file."""
        return open_recording(self.recording_path)

    def report(self, path: str | Path | None = None) -> Path:
        """Write the report, beside the recording where no path is given, and return where it is.

        Parameters
        ----------
        path : str or Path, optional
            Where to; what is there is replaced.

        Returns
        -------
        Path
            The report.
        """
        from duralab.report import write_report

        return write_report(self.recording, path or self.recording_path.with_name("report.html"))

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"CampaignResult({self.status.id}: {self.verdict.judgement})"

    def __str__(self) -> str:
        """Return it as a table."""
        from duralab.showing.campaigns import result_text

        return result_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.campaigns import result_html

        return result_html(self)
