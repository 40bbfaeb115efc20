"""How iterations, campaigns and recordings look."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.iteration_table import DAMAGE_SPENT_SLOPE, counted_slope
from duralab.showing.charts import Axis, Curve, line_chart
from duralab.showing.tables import html_table, text_table
from duralab.target_step_record import READ_FILE
from duralab.verdict import Criterion

if TYPE_CHECKING:
    from duralab.campaign_result import CampaignResult
    from duralab.catalogue import CatalogueEntry
    from duralab.iteration_table import IterationTable
    from duralab.recording import Recording
    from duralab.verdict import Verdict

_ITERATIONS: Final = "relative RMS error (RMS response), 0 (1) is perfect"


def _iteration_rows(table: IterationTable) -> tuple[list[str], list[list[str]]]:
    marks = (" (watched)" if watched else "" for watched in table.watched)
    names = (f"{name.replace('_', ' ')}{mark}" for name, mark in zip(table.channels, marks, strict=True))
    rows = [[str(number), *table.cells(row), f"{table.overall[row]:.3f}"] for row, number in enumerate(table.numbers)]
    if len(table):
        spent = table.damage_spent().sum(axis=0)
        rows.append([f"damage spent (k = {DAMAGE_SPENT_SLOPE})", *map(passes, spent), "passes"])
    return ["playback", *names, "overall"], rows


def passes(damage: float) -> str:
    """Return damage spent in passes of the target, as it is shown; a dash where it is not known."""
    if np.isnan(damage):
        return "–"
    return f"{damage:.1f}" if damage < 100 else f"{damage:,.0f}"


def judged_rows(
    table: IterationTable, verdict: Verdict, *, slope: int
) -> tuple[list[tuple[str, str]], list[list[str]]]:
    """Return the figures of the best playback that are judged, with ✗ at those outside their limits.

    The heading of each column is its name and what is allowed, or its unit.

    Parameters
    ----------
    table : IterationTable
        One playback or more.
    verdict : Verdict
        On the best of them.
    slope : int
        Of the S-N line that the damage spent is counted at.
    """
    limits, spent = verdict.limits, table.damage_spent(slope).sum(axis=0)
    judged = [criterion for criterion in Criterion if limits.bounds(criterion) is not None]
    names = {
        Criterion.ERROR: "error",
        Criterion.DAMAGE: f"damage, k = {limits.damage_exponent}",
        Criterion.OUTSIDE: "energy outside band",
    }
    header = [(names.get(criterion, limits.name(criterion)), limits.allowed(criterion)) for criterion in judged]
    rows = []
    for i, channel in enumerate(table.channels):
        findings = [verdict.of(channel, criterion) for criterion in judged]
        cells = ["–" if found is None else f"{found}{'' if found.accepted else ' ✗'}" for found in findings]
        mark = " (watched)" if table.watched[i] else ""
        rows.append([f"{channel.replace('_', ' ')}{mark}", *cells, passes(spent[i])])
    return [("channel", ""), *header, ("damage spent", f"passes, k = {slope}")], rows


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
    judged = text_table(*_judged(result), left=1) if len(result.iterations) else ""
    return f"{result.iterations}\n{judged}\n{result.verdict.sentence}{remarks}"


def _judged(result: CampaignResult) -> tuple[list[str], list[list[str]]]:
    header, rows = judged_rows(result.iterations, result.verdict, slope=counted_slope(result.specification))
    return [", ".join(filter(None, heading)) for heading in header], rows


def result_html(result: CampaignResult) -> str:
    """Return the same as HTML."""
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in result.status.remarks)
    verdict = f"<p><b>{escape(result.verdict.sentence)}</b></p>"
    judged = html_table(*_judged(result), left=1) if len(result.iterations) else ""
    return f"{verdict}{judged}{iterations_html(result.iterations)}{f'<ul>{remarks}</ul>' if remarks else ''}"


def _target_lines(recording: Recording) -> str:
    """Return how the target was made, a line for each step."""
    steps = recording.specification.target_steps
    first = 0 if steps and steps[0].name == READ_FILE else 1
    return "".join(f"target, step {number}, {step.name}: {step.finding}\n" for number, step in enumerate(steps, first))


def _recording_title(recording: Recording) -> str:
    whole = f"; {recording.open_end}".rstrip("; .") if recording.whole else "; never finished"
    specification = recording.specification
    return f"{specification.id} on {recording.rig.rig}, {len(recording.runs)} runs, {recording.path}{whole}"


def recording_text(recording: Recording) -> str:
    """Return what a recording holds as text."""
    return f"{_recording_title(recording)}\n{_target_lines(recording)}{recording.iterations}"


def recording_html(recording: Recording) -> str:
    """Return the same as HTML."""
    lines = "".join(f"<p>{escape(line)}</p>" for line in _target_lines(recording).splitlines())
    return f"<p>{escape(_recording_title(recording))}</p>{lines}{iterations_html(recording.iterations)}"


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
