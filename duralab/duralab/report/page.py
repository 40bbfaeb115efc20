"""Putting the report together: figures, tables and the page they stand in."""

from __future__ import annotations

import base64
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from duralab._outputs import replace_when_complete
from duralab.errors import InputError
from duralab.recording import Recording, open_recording
from duralab.report import figures, tables, waveforms
from duralab.verdict import Judgement, accepted_error, compare_with_first, judge

_ICONS = {
    Judgement.REACHED: "good",
    Judgement.NOT_JUDGED: "neutral",
    Judgement.NOT_REACHED: "bad",
    Judgement.DIVERGED: "bad",
    Judgement.ENDED_EARLY: "bad",
}


def write_report(source: str | Path | Recording, path: str | Path) -> Path:
    """Write the report of a recording.

    Parameters
    ----------
    source : str, Path or Recording
        The recording.
    path : str or Path
        Where the HTML file goes; one that is there is replaced when the new one is complete.

    Returns
    -------
    Path
        Where it is.

    Raises
    ------
    InputError
        The recording cannot be read, or holds no playback yet.
    """
    recording = source if isinstance(source, Recording) else open_recording(source)
    html = render_report(recording)
    with replace_when_complete(Path(path)) as temporary:
        temporary.write_text(html, encoding="utf-8")
    return Path(path)


def render_report(recording: Recording) -> str:
    """Return the report as HTML; see `write_report`."""
    table = recording.iterations
    if not len(table):
        raise InputError(
            f"The recording {recording.path} holds no playback of the target, so there is nothing to report."
        )
    specification = recording.specification
    verdict = judge(table, limit=accepted_error(specification), status=recording.status)
    shown = _shown(recording)
    band, model = shown.band, recording.model
    drawn: dict[str, Any] = {
        "error": figures.error_per_playback(table, limit=verdict.limit),
        "response": figures.response_per_playback(table),
        "use": figures.actuator_use_per_playback(recording.actuators, table.numbers),
    }
    for row, density in enumerate(waveforms.spectrum(shown)):
        drawn[f"zoom-{row}"] = waveforms.zoomed_waveform(shown, row)
        drawn[f"wave-{row}"] = waveforms.waveform(shown, row)
        drawn[f"psd-{row}"] = density
    for row in range(len(shown.last.drive.channels)):
        drawn[f"drive-{row}"] = waveforms.drive(shown, row)
    if model is not None:
        drawn["coherence"] = figures.coherence(model, band=band)
        drawn["condition"] = figures.condition_number(model, band=band)
        for i in range(len(model.responses)):
            for j in range(len(model.drives)):
                drawn[f"frf-{i}-{j}"] = figures.model_element(model, i, j, band=band)
    window = waveforms.zoom_window(shown.target)
    scenario = specification.scenario
    return _template().render(
        asset=_asset,
        plotly=Markup(get_plotlyjs()),
        # "</" would end the script element, wherever it stands in a string.
        figures=Markup(json.dumps(drawn, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")),
        recording=recording,
        specification=specification,
        verdict=verdict,
        tone=_ICONS[verdict.judgement],
        comparison=compare_with_first(table),
        table=table,
        channels=shown.target.channels,
        drives=shown.last.drive.channels,
        rows=tables.channel_rows(table, shown.target, limit=verdict.limit),
        playbacks=tables.playback_rows(table),
        repeatability=_repeatability(recording),
        actuators=tables.actuator_rows(shown.last.actuators, shown.last.drive.channels),
        cells=tables.matrix_cells(figures.contributions(model, band)) if model is not None else [],
        model=model,
        method=tables.method_in_words(specification),
        provenance=tables.provenance(recording),
        shown=shown,
        zoom=(window.start / shown.target.sample_rate, window.stop / shown.target.sample_rate),
        scenario=scenario,
        scenario_link=base64.b64encode(scenario.encode()).decode(),
    )


def _shown(recording: Recording) -> waveforms.Shown:
    table, specification = recording.iterations, recording.specification
    numbers = {table.numbers[0], table.numbers[table.best], table.numbers[-1]}
    playbacks = {number: recording.playback(number) for number in numbers}
    return waveforms.Shown(
        target=recording.target,
        first=playbacks[table.numbers[0]],
        best=playbacks[table.numbers[table.best]],
        last=playbacks[table.numbers[-1]],
        band=(specification.lowest_frequency, specification.highest_frequency),
        block_samples=specification.estimator.block_samples,
    )


def _repeatability(recording: Recording) -> dict[str, Any] | None:
    """Return what the report says of a drive that was played again; None where none was."""
    status = recording.status
    if status is None or not status.HasField("repeatability"):
        return None
    told = status.repeatability
    rows = tables.repeatability_rows(told, recording.iterations)
    return {"iteration": told.iteration, "playbacks": told.playbacks, "rows": rows}


def _asset(name: str) -> Markup:
    return Markup((files("duralab.report") / name).read_text(encoding="utf-8"))


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("duralab.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2")
