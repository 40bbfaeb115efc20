"""Report of one campaign: figures, tables and page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from duralab.campaign import Criterion, Judgement, Verdict, compare_with_first
from duralab.data import (
    DAMAGE_SLOPES,
    SENSOR_COLUMNS,
    Channel,
    IterationTable,
    Model,
    Signals,
    channels_of,
    counted_slope,
    damage_note,
    sensor_rows,
)
from duralab.errors import InputError
from duralab.recording import Recording, open_recording
from duralab.report import convergence_figures, load_figures, model_figures, tables, waveforms
from duralab.report.actuator_rows import actuator_rows, held_rows
from duralab.report.drawing import Figure
from duralab.report.endurance_report import write_endurance_report
from duralab.report.held_drives import HeldStretch, held_stretches
from duralab.report.provenance import decision_rows, method_in_words, provenance, source_rows, target_step_rows
from duralab.report.rendering import PACKAGE, page_template, render, write_page

# Compiled with the import, which `duralab run` makes while the rig plays: a third of the page's time.
page_template("report.html.j2", PACKAGE)

TONES: Final = {
    Judgement.REACHED: "good",
    Judgement.NOT_REACHED: "bad",
    Judgement.DIVERGED: "bad",
    Judgement.ENDED_EARLY: "bad",
}


def write_report(source: str | Path | Recording, path: str | Path) -> Path:
    """Write the report of a recording, of a campaign or of an endurance test.

    Parameters
    ----------
    source : str, Path or Recording
        Recording or its path.
    path : str or Path
        Path of the HTML file; an existing file is replaced when the new one is complete.

    Returns
    -------
    Path
        Path of the report.

    Raises
    ------
    InputError
        The recording cannot be read or has no playback or repeat, or `path` is a file of it.
    """
    recording = source if isinstance(source, Recording) else open_recording(source)
    if recording.is_endurance:
        return write_endurance_report(recording.path, path)
    return write_page(path, lambda: render_report(recording), read=recording.files)


def render_report(recording: Recording) -> str:
    """Return the report as HTML; see `write_report`."""
    table = recording.iterations
    if not len(table):
        raise InputError(
            f"The recording {recording.path} holds no playback of the target, so there is nothing to report; "
            "give one that has."
        )
    specification = recording.specification
    slope = counted_slope(specification)
    verdict = recording.verdict
    shown, model = shown_playbacks(recording), recording.model
    held = held_stretches(shown.best.drive)
    window = waveforms.zoom_window(shown.target)
    channels, drives = shown.target.channels, shown.best.drive.channels
    return render(
        "report.html.j2",
        figures={
            "error": convergence_figures.error_per_playback(table, limit=verdict.limits.relative_rms_error),
            "response": convergence_figures.response_per_playback(table),
            "use": convergence_figures.actuator_use_per_playback(recording.actuators, table.numbers),
            **{f"damage-{slope}": convergence_figures.damage_per_playback(table, slope) for slope in DAMAGE_SLOPES},
            **_signal_figures(shown, held),
            **_load_figures(shown),
            **(_model_figures(model, shown.band) if model is not None else {}),
        },
        recording=recording,
        specification=specification,
        table=table,
        shown=shown,
        zoom=(window.start / shown.target.sample_rate, window.stop / shown.target.sample_rate),
        channels=channels,
        channel_options=_options(channels),
        drives=drives,
        drive_options=_options(drives),
        actuators=actuator_rows(shown.best.actuators, shown.best.drive),
        held=held_rows(held, drives),
        steps=target_step_rows(specification),
        sources=source_rows(specification),
        sensor_columns=SENSOR_COLUMNS,
        sensors=sensor_rows(channels_of(recording.rig.responses)),
        method=method_in_words(specification),
        decisions=decision_rows(recording),
        provenance=provenance(recording, shown.best),
        scenario=specification.scenario,
        scenario_link=base64.b64encode(specification.scenario.encode()).decode(),
        **_judged_parts(table, verdict, shown.target, slope=slope),
        **_damage_parts(table, slope),
        **_model_parts(model, shown.band),
        **_remark_parts(recording),
    )


def _judged_parts(table: IterationTable, verdict: Verdict, target: Signals, *, slope: int) -> dict[str, Any]:
    """Return the page's content about the errors."""
    return {
        "verdict": verdict,
        "tone": TONES[verdict.judgement],
        "comparison": compare_with_first(table),
        "criteria": Criterion,
        "accepted": len(set(table.judged) - {finding.channel for finding in verdict.failed}),
        "judged": len(table.judged),
        "rows": tables.channel_rows(table, target, verdict=verdict, slope=slope),
        "playbacks": tables.playback_rows(table),
        "forecasts": tables.forecast_rows(table),
    }


def _damage_parts(table: IterationTable, slope: int) -> dict[str, Any]:
    """Return the page's content about the damage of the first, the best and the last playback."""
    playbacks = list(dict.fromkeys((0, table.best, len(table) - 1)))
    return {
        "slopes": DAMAGE_SLOPES,
        "slope_options": [(slope, f"k = {slope}") for slope in (5, 3, 8)],
        "damage": tables.damage_rows(table, playbacks),
        "damage_columns": [table.numbers[row] for row in playbacks],
        "spent_slope": slope,
        "spent": tables.damage_spent_rows(table, slope),
        "spent_sums": tables.damage_sum_rows(table),
        "spent_note": damage_note(table),
    }


def _model_parts(model: Model | None, band: tuple[float, float]) -> dict[str, Any]:
    """Return the page's content about the model, empty if there is none."""
    if model is None:
        return {"model": None, "cells": [], "response_options": [], "distortion": []}
    found = model.distortion
    return {
        "model": model,
        "cells": tables.matrix_cells(model_figures.contributions(model, band)),
        "response_options": _options(model.responses),
        "distortion": [tables.shares_in_words(found, row) for row in range(found.noise_share.size)] if found else [],
    }


def _remark_parts(recording: Recording) -> dict[str, Any]:
    """Return the remarks, each sentence once, and the repeatability of a drive."""
    remarks = set(recording.remarks)
    status_remarks = recording.status.remarks if recording.status is not None else ()
    return {
        "remarks": [sentence for sentence in status_remarks if sentence not in remarks],
        "told_on_the_way": recording.remarks,
        "repeatability": _repeatability(recording),
    }


def _signal_figures(shown: waveforms.Shown, held: list[HeldStretch]) -> dict[str, Figure]:
    figures = {}
    for row, density in enumerate(waveforms.spectrum(shown)):
        figures[f"zoom-{row}"] = waveforms.zoomed_waveform(shown, row)
        figures[f"wave-{row}"] = waveforms.waveform(shown, row, held)
        figures[f"psd-{row}"] = density
    for row in range(len(shown.best.drive.channels)):
        figures[f"drive-{row}"] = waveforms.drive(shown, row, held)
    return figures


def _load_figures(shown: waveforms.Shown) -> dict[str, Figure]:
    figures = {}
    for row, channel in enumerate(shown.target.channels):
        counted = load_figures.counted_loads(shown, row)
        figures[f"pairs-{row}"] = load_figures.range_pairs(counted, channel.unit)
        figures[f"crossings-{row}"] = load_figures.level_crossings(counted, channel.unit)
        figures[f"times-{row}"] = load_figures.time_at_level(counted, channel.unit)
        figures[f"wanted-{row}"] = load_figures.range_mean(counted, 0, channel.unit)
        figures[f"done-{row}"] = load_figures.range_mean(counted, -1, channel.unit)
    return figures


def _model_figures(model: Model, band: tuple[float, float]) -> dict[str, Figure]:
    figures = {
        "coherence": model_figures.coherence(model, band=band),
        "condition": model_figures.condition_number(model, band=band),
    }
    for i in range(len(model.responses)):
        for j in range(len(model.drives)):
            figures[f"frf-{i}-{j}"] = model_figures.model_element(model, i, j, band=band)
        if model.distortion is not None:
            figures[f"linear-{i}"] = model_figures.nonlinearity(model, model.distortion, i, band=band)
    return figures


def _options(channels: Sequence[Channel]) -> list[tuple[int, str]]:
    return [(row, channel.title) for row, channel in enumerate(channels)]


def shown_playbacks(recording: Recording) -> waveforms.Shown:
    """Return the target of a recording, and its first, best and last playback."""
    table, specification = recording.iterations, recording.specification_in_use
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
    """Return the content about the repeatability of a drive; None if no drive was repeated."""
    status = recording.status
    if status is None or not status.HasField("repeatability"):
        return None
    repeatability = status.repeatability
    rows = tables.repeatability_rows(repeatability, recording.iterations)
    return {"iteration": repeatability.iteration, "playbacks": repeatability.playbacks, "rows": rows}
