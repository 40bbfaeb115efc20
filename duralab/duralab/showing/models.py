"""How models, experiments and what is told of them look."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.showing.charts import Axis, Curve, line_chart
from duralab.showing.tables import html_table, text_table
from duralab.showing.values import MOST_CHARTS

if TYPE_CHECKING:
    from duralab.identification_results import Convergence, ExperimentPlan, LevelAdvice
    from duralab.recording_content import Model

_FREQUENCY: Final = Axis("frequency [Hz]", logarithmic=True)
_SMALLEST_LEVEL: Final = 1e-3
"""Lines whose drives have less than this share of the strongest line's density were not excited."""

_MODEL: Final = ("response", "unit", "lowest coherence", "median coherence", "relative deviation of its FRF")


def excited_lines(model: Model) -> np.ndarray:
    """Return which lines the experiment excited, shape (lines); elsewhere the estimate means nothing."""
    level = np.nan_to_num(model.drive_psd).max(axis=1)
    known = np.abs(np.nan_to_num(model.frf)).max(axis=(1, 2)) > 0.0
    return (level > _SMALLEST_LEVEL * level.max()) & known & (model.frequency > 0.0)


def _model_rows(model: Model) -> list[tuple[str, ...]]:
    lines = excited_lines(model)
    rows = []
    for i, channel in enumerate(model.responses):
        coherence = model.coherence[lines, i]
        size = np.linalg.norm(model.frf[lines, i], axis=1)
        deviation = np.median(np.linalg.norm(model.frf_deviation[lines, i], axis=1) / size) if lines.any() else np.nan
        known = np.isfinite(deviation) and deviation > 0.0
        low, middle = (np.min(coherence), np.median(coherence)) if lines.any() else (np.nan, np.nan)
        told = f"{deviation:.1%}" if known else "–"
        rows.append((channel.name, channel.unit, f"{low:.3f}", f"{middle:.3f}", told))
    return rows


def _model_title(model: Model) -> str:
    frequency = model.frequency[excited_lines(model)]
    band = f"{frequency.min():.2g} to {frequency.max():.3g} Hz, {frequency.size} lines" if frequency.size else "no line"
    return (
        f"FRF of {len(model.responses)} responses and {len(model.drives)} drives: {band}, "
        f"{model.independent_averages:.1f} independent averages"
    )


def model_text(model: Model) -> str:
    """Return coherence and uncertainty of each response, and the verdicts, as text."""
    sentences = "".join(f"\n- {sentence}" for sentence in (*model.verdicts, *model.warnings))
    return f"{_model_title(model)}\n{text_table(_MODEL, _model_rows(model), left=2)}{sentences}"


def model_html(model: Model) -> str:
    """Return the same as HTML, with the magnitude of the FRF and the coherence."""
    lines = excited_lines(model)
    frequency = model.frequency[lines]
    charts = [
        line_chart(
            [
                Curve(drive.title, frequency, np.abs(model.frf[lines, i, j]))
                for j, drive in enumerate(model.drives[:MOST_CHARTS])
            ],
            x=_FREQUENCY,
            y=Axis(f"|H| [{response.unit} per drive unit]", logarithmic=True),
            title=response.title,
        )
        for i, response in enumerate(model.responses[:MOST_CHARTS])
    ]
    if len(model.responses) > MOST_CHARTS or len(model.drives) > MOST_CHARTS:
        charts.append(f"<p>Drawn are the first {MOST_CHARTS} responses and drives.</p>")
    coherence = [
        Curve(response.title, frequency, model.coherence[lines, i])
        for i, response in enumerate(model.responses[:MOST_CHARTS])
    ]
    charts.append(line_chart(coherence, x=_FREQUENCY, y=Axis("multiple coherence"), from_zero=True))
    table = html_table(_MODEL, _model_rows(model), left=2, caption=_model_title(model))
    return f"{table}{_list((*model.verdicts, *model.warnings))}{''.join(charts)}"


def plan_text(plan: ExperimentPlan) -> str:
    """Return what an experiment takes and gives as text."""
    low, high = plan.band
    rows = (
        ("duration", f"{plan.duration_seconds:.1f} s"),
        ("realisations", str(plan.realisations)),
        ("experiments per realisation", str(plan.experiments_per_realisation)),
        ("periods", str(plan.periods)),
        ("share of delays", f"{plan.delay_share:.0%}"),
        ("independent averages", f"{plan.independent_averages:.1f}"),
        ("band", f"{low:.3g} to {high:.3g} Hz, {plan.lines} lines, one every {plan.frequency_resolution:.3g} Hz"),
    )
    return text_table(("experiment", ""), rows, left=2)


def advice_text(advice: LevelAdvice) -> str:
    """Return advised, wanted and largest RMS of each drive, and why, as text."""
    rows = [
        (str(number), *(f"{value:.3g}" for value in values))
        for number, values in enumerate(zip(advice.rms, advice.wanted_rms, advice.largest_rms, strict=True), start=1)
    ]
    table = text_table(("drive", "advised RMS", "wanted", "largest"), rows)
    return "\n".join((table, *(f"- {sentence}" for sentence in advice.sentences)))


def convergence_html(convergence: Convergence) -> str:
    """Return the spectral radius over frequency as a picture, below 1 it converges, and the sentence."""
    frequency = convergence.frequency
    curves = [
        Curve("expected", frequency, convergence.spectral_radius),
        Curve("95 % of the rigs are below", frequency, convergence.spectral_radius_95),
        Curve("1", frequency, np.ones_like(frequency)),
    ]
    chart = line_chart(curves, x=_FREQUENCY, y=Axis("spectral radius"), from_zero=True)
    return f"<p>{escape(convergence.sentence)}</p>{chart}"


def _list(sentences: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""
