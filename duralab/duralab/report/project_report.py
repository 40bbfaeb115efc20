"""Report of a project: a table of all events, and a section for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from duralab.campaign import Criterion
from duralab.data import counted_slope
from duralab.recording import Recording
from duralab.report import convergence_figures, tables, waveforms
from duralab.report.campaign_report import TONES, shown_playbacks
from duralab.report.drawing import Figure
from duralab.report.rendering import render, write_page


@dataclass(frozen=True)
class EventSection:
    """Section of an event of a project.

    Parameters
    ----------
    name : str
        Name of the event.
    recording : Recording
        Recording of its campaign, with at least one playback.
    report : str
        Path of the event's report, relative to the page.
    """

    name: str
    recording: Recording
    report: str


def write_project_report(
    path: str | Path,
    *,
    name: str,
    sentence: str,
    reached: bool,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    events: Sequence[EventSection],
) -> Path:
    """Write the report of a project.

    Parameters
    ----------
    path : str or Path
        Path of the HTML file; an existing file is replaced when the new one is complete.
    name, sentence : str
        Name of the project, and its result as a sentence.
    reached : bool
        Whether every event reached its target.
    header, rows : sequence of str
        Header and rows of the table of results.
    events : sequence of EventSection
        Events with a result, in the order in which they were made.

    Returns
    -------
    Path
        Path of the report.

    Raises
    ------
    InputError
        A recording cannot be read, or `path` cannot be written.
    """
    read = [file for event in events for file in event.recording.files]

    def page() -> str:
        figures: dict[str, Figure] = {}
        sections = [_section(number, event, figures) for number, event in enumerate(events)]
        return render(
            "project.html.j2",
            figures=figures,
            name=name,
            sentence=sentence,
            tone="good" if reached else "bad",
            header=header,
            rows=rows,
            events=sections,
            criteria=Criterion,
        )

    return write_page(path, page, read=read)


def _section(number: int, event: EventSection, figures: dict[str, Figure]) -> dict[str, Any]:
    """Return the page's content about an event, and add its figures."""
    recording = event.recording
    table, verdict, shown = recording.iterations, recording.verdict, shown_playbacks(recording)
    figures[f"error-{number}"] = convergence_figures.error_per_playback(table, limit=verdict.limits.relative_rms_error)
    names = [channel.name for channel in shown.target.channels]
    worst = table.judged[int(table.judged_error[table.best].argmax())]
    figures[f"zoom-{number}"] = waveforms.zoomed_waveform(shown, names.index(worst))
    specification = recording.specification
    return {
        "number": number,
        "name": event.name,
        "report": event.report,
        "id": specification.id,
        "source": specification.target_source,
        "verdict": verdict,
        "tone": TONES[verdict.judgement],
        "channels": shown.target.channels,
        "worst": worst.replace("_", " "),
        "best": table.numbers[table.best],
        "learned_from": list(specification.known.learn_from),
        "first_drive": specification.known.first_drive.source,
        "model": specification.known.model_source,
        "rows": tables.channel_rows(table, shown.target, verdict=verdict, slope=counted_slope(specification)),
    }
