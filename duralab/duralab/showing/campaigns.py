"""How iterations, campaigns and recordings look."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.showing.charts import Axis, Curve, line_chart
from duralab.showing.tables import html_table, text_table

if TYPE_CHECKING:
    from duralab.campaign_result import CampaignResult
    from duralab.catalogue import CatalogueEntry
    from duralab.iteration_table import IterationTable
    from duralab.recording import Recording

_ITERATIONS: Final = "relative RMS error (RMS response), 0 (1) is perfect"


def _iteration_rows(table: IterationTable) -> tuple[list[str], list[list[str]]]:
    marks = (" (watched)" if watched else "" for watched in table.watched)
    names = (f"{name.replace('_', ' ')}{mark}" for name, mark in zip(table.channels, marks, strict=True))
    rows = [[str(number), *table.cells(row), f"{table.overall[row]:.3f}"] for row, number in enumerate(table.numbers)]
    return ["playback", *names, "overall"], rows


def iterations_text(table: IterationTable) -> str:
    """Return error and RMS response of each playback and channel as text."""
    return f"{_ITERATIONS}\n{text_table(*_iteration_rows(table))}"


def iterations_html(table: IterationTable) -> str:
    """Return the same as HTML, with the error over the playbacks."""
    if not len(table):
        return "<p>No playback yet.</p>"
    numbers = np.array(table.numbers, dtype=np.float64)
    curves = [
        Curve(name.replace("_", " "), numbers, column)
        for name, column in zip(table.channels, table.relative_rms_error.T, strict=True)
    ]
    chart = line_chart(curves, x=Axis("playback"), y=Axis("relative RMS error"), from_zero=True)
    return html_table(*_iteration_rows(table), caption=_ITERATIONS) + chart


def result_text(result: CampaignResult) -> str:
    """Return table, verdict and remarks of a campaign as text."""
    remarks = "".join(f"\n- {remark}" for remark in result.status.remarks)
    return f"{result.iterations}\n{result.verdict.sentence}{remarks}"


def result_html(result: CampaignResult) -> str:
    """Return the same as HTML."""
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in result.status.remarks)
    verdict = f"<p><b>{escape(result.verdict.sentence)}</b></p>"
    return f"{verdict}{iterations_html(result.iterations)}{f'<ul>{remarks}</ul>' if remarks else ''}"


def _recording_title(recording: Recording) -> str:
    whole = f"; {recording.open_end}".rstrip("; .") if recording.whole else "; never finished"
    specification = recording.specification
    return f"{specification.id} on {recording.rig.rig}, {len(recording.runs)} runs, {recording.path}{whole}"


def recording_text(recording: Recording) -> str:
    """Return what a recording holds as text."""
    return f"{_recording_title(recording)}\n{recording.iterations}"


def recording_html(recording: Recording) -> str:
    """Return the same as HTML."""
    return f"<p>{escape(_recording_title(recording))}</p>{iterations_html(recording.iterations)}"


_CATALOGUE: Final = ("recording", "rig", "target", "begun", "result", "size")


def _catalogue_rows(entries: Sequence[CatalogueEntry]) -> list[tuple[str, ...]]:
    return [
        (
            entry.id,
            entry.rig,
            entry.target,
            f"{entry.begun:%Y-%m-%d %H:%M} UTC" if entry.begun is not None else "–",
            entry.result if entry.closed else f"{entry.result}, not closed",
            f"{entry.bytes / 1e6:.1f} MB",
        )
        for entry in entries
    ]


def catalogue_text(entries: Sequence[CatalogueEntry]) -> str:
    """Return a line for each recording."""
    return text_table(_CATALOGUE, _catalogue_rows(entries), left=5) if entries else "There is no such recording."


def catalogue_html(entries: Sequence[CatalogueEntry]) -> str:
    """Return the same as HTML."""
    return html_table(_CATALOGUE, _catalogue_rows(entries), left=5) if entries else "<p>There is no such recording.</p>"
