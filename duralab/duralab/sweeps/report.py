"""Report of a sweep: one offline HTML file with figures that compare its points."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.errors import InputError
from duralab.report import render, write_page
from duralab.sweeps.campaign_task import CAMPAIGN
from duralab.sweeps.results import POINTS, SweepResults

MOST_ROWS: Final = 500
"""Maximum number of points in the report's table, the best first; results.parquet has all."""


def write_report(results: SweepResults, path: str | Path) -> Path:
    """Write the report of a sweep; an existing file is replaced when the new one is complete."""
    if not results.rows:
        raise InputError(
            f"No campaign of the sweep in {results.folder} has ended, so there is nothing to report; continue the "
            "sweep."
        )
    return write_page(path, lambda: render_report(results))


def render_report(results: SweepResults) -> str:
    """Return the report as HTML; see `write_report`."""
    objective, best = results.objective.value, results.best
    keys = varied(results)
    drawn = {f"axis-{row}": along_axis(results, key) for row, key in enumerate(keys)}
    if results.finished:
        drawn["all"] = parallel_coordinates(results)
    ranked = sorted(results.finished, key=lambda row: row[objective])
    return render(
        "page.html.j2",
        package="duralab.sweeps",
        figures=drawn,
        results=results,
        objective=words(objective),
        keys=keys,
        best=best,
        best_settings=[(key, text(best[key])) for key in results.keys] if best is not None else [],
        rerun=_rerun(best) if best is not None else "",
        rows=[_row(results, row, rank) for rank, row in enumerate(ranked[:MOST_ROWS], start=1)],
        summaries=[(key, _summary(results, key)) for key in keys],
        costs=_costs(results),
        text_of=text,
        sweep_link=base64.b64encode(results.text.encode()).decode(),
        version=version("duralab"),
    )


def _rerun(best: Mapping[str, Any]) -> str:
    """Return the command that runs a point again from the sweep's folder, with identical results."""
    place = f"{POINTS}/{best['id']}/{CAMPAIGN}"
    return f"duralab run {shlex.quote(place)} --out best"


def _row(results: SweepResults, row: Mapping[str, Any], rank: int) -> dict[str, Any]:
    recording = results.folder / POINTS / row["id"] / "recording.mcap"
    return {
        "rank": rank,
        "settings": [text(row.get(key)) for key in results.keys],
        "overall": f"{row['overall_error']:.4f}",
        "worst": f"{row['worst_error']:.4f}",
        "playback": row["best_playback"],
        "judgement": row["judgement"],
        "seconds": f"{row['seconds_campaign']:.1f}",
        "id": row["id"],
        "recorded": recording.is_file(),
    }


def _summary(results: SweepResults, key: str) -> list[tuple[str, int, str, str, str]]:
    """Return the number of points, and the minimum, median and maximum error, for each value of a setting."""
    lines = []
    values = ordered_values(results.finished, key)
    for value in values[:MOST_BOXES]:
        found = [row[results.objective.value] for row in results.finished if row.get(key) == value]
        lines.append((text(value), len(found), f"{min(found):.4f}", f"{np.median(found):.4f}", f"{max(found):.4f}"))
    return lines if len(values) <= MOST_BOXES else []


def _costs(results: SweepResults) -> list[tuple[str, str]]:
    def span_text(name: str) -> str:
        seconds = np.array([row[name] for row in results.rows if row[name] is not None])
        return f"{np.median(seconds):.2f} s in the middle, {seconds.max():.2f} s at most, {seconds.sum():.0f} s in all"

    size = sum(row["bytes"] or 0 for row in results.rows)
    return [
        ("Opening rig cells", span_text("seconds_cell")),
        ("Campaigns", span_text("seconds_campaign")),
        ("Processor time of the workers", span_text("seconds_processor")),
        ("Recordings", f"{size / 2**20:,.0f} MiB"),
    ]


Figure = dict[str, Any]

MOST_BOXES: Final = 24
"""Maximum number of values of a setting with a box each; with more values every point is drawn."""

MOST_LINES: Final = 500
"""Maximum number of points in the parallel coordinates, the best first."""

FEW_TICKS: Final = 10
"""Maximum number of ticks of an axis."""

ERRORS: Final = ("overall_error", "worst_error")

SHADES: Final = ("#0b3d91", "#1565c0", "#2a9fd0", "#4fb8a8", "#8ac45a", "#d6b93a", "#e79a4b", "#e3b7a0")
"""Colours of lines, from the best eighth of the points to the worst."""


def words(name: str) -> str:
    """Return the name of an error as text, e.g. "overall error"."""
    return name.replace("_", " ")


def varied(results: SweepResults) -> list[str]:
    """Return the settings that differ between finished points."""
    return [key for key in results.keys if len({repr(row.get(key)) for row in results.finished}) > 1]


def ordered_values(rows: Sequence[Mapping[str, Any]], key: str) -> list[Any]:
    """Return the different values of a setting: numbers by size, others by name."""
    values = {row.get(key) for row in rows}
    return sorted(values, key=lambda value: (not _is_number(value), value if _is_number(value) else str(value)))


def parallel_coordinates(results: SweepResults) -> Figure:
    """Return the best points as lines across their settings and errors, from light to dark as the error falls.

    They are drawn as plain lines: plotly's parallel coordinates need WebGL, which not every browser has.
    """
    ranked = sorted(results.finished, key=lambda row: row[results.objective.value])[:MOST_LINES]
    keys = [*varied(results), *ERRORS]
    scales = {key: _Scale.of(ranked, key) for key in keys}
    shades = min(len(SHADES), len(ranked))
    traces = []
    # The best points are drawn last, over the others.
    for shade in reversed(range(shades)):
        rows = ranked[len(ranked) * shade // shades : len(ranked) * (shade + 1) // shades]
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                # A gap after each line: many lines are one trace.
                "x": [place for _ in rows for place in (*range(len(keys)), None)],
                "y": [height for row in rows for height in (*(scales[key].height(row[key]) for key in keys), None)],
                "text": [line for row in rows for line in (*([_hover_text(row, keys)] * len(keys)), None)],
                "hoverinfo": "text",
                "line": {"color": SHADES[shade], "width": 1.6},
            }
        )
    posts = [
        {"type": "line", "x0": place, "x1": place, "y0": 0, "y1": 1, "line": {"color": "@muted", "width": 1}}
        for place in range(len(keys))
    ]
    ticks = [
        {
            "x": place,
            "y": height,
            "text": tick,
            "xanchor": "right",
            "showarrow": False,
            "bgcolor": "@page",
            "opacity": 0.85,
            "font": {"size": 11},
        }
        for place, key in enumerate(keys)
        for height, tick in scales[key].ticks
    ]
    layout = {
        "xaxis": {
            "tickmode": "array",
            "tickvals": list(range(len(keys))),
            "ticktext": [words(key) if key in ERRORS else key for key in keys],
            "range": [-0.25, len(keys) - 0.8],
            "showgrid": False,
            "zeroline": False,
        },
        "yaxis": {"visible": False, "range": [-0.05, 1.05]},
        "shapes": posts,
        "annotations": ticks,
        "showlegend": False,
    }
    return {"data": traces, "layout": layout}


def along_axis(results: SweepResults, key: str) -> Figure:
    """Return a chart of the compared error over one setting: a box for each value, or a point for each campaign."""
    rows, objective = results.finished, results.objective.value
    values = ordered_values(rows, key)
    layout: Figure = {
        "xaxis": {"title": {"text": key}},
        "yaxis": {"title": {"text": words(objective)}, "rangemode": "tozero"},
        "showlegend": False,
    }
    if len(values) > MOST_BOXES:
        trace = {
            "type": "scatter",
            "mode": "markers",
            "x": [row.get(key) for row in rows],
            "y": [row[objective] for row in rows],
            "marker": {"color": "@last", "size": 6, "opacity": 0.7},
        }
        return {"data": [trace], "layout": layout}
    layout["xaxis"] |= {
        "type": "category",
        "categoryorder": "array",
        "categoryarray": [text(value) for value in values],
    }
    traces = [
        {
            "type": "box",
            "name": text(value),
            "x": [text(value)] * len(figures),
            "y": figures,
            "boxpoints": "all",
            "pointpos": 0,
            "jitter": 0.4,
            "marker": {"color": "@last", "size": 4},
            "line": {"color": "@last", "width": 1.5},
        }
        for value in values
        if (figures := [row[objective] for row in rows if row.get(key) == value])
    ]
    return {"data": traces, "layout": layout}


def text(value: Any) -> str:
    """Return a setting as text."""
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class _Scale:
    """Scale of one axis of the parallel coordinates: heights from 0 to 1 of numbers, or of names by `order`."""

    lowest: float
    highest: float
    order: Mapping[str, float]
    ticks: Sequence[tuple[float, str]]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]], key: str) -> _Scale:
        values = ordered_values(rows, key)
        if not all(_is_number(value) for value in values):
            order = {text(value): row / max(1, len(values) - 1) for row, value in enumerate(values)}
            return cls(0.0, 1.0, order, [(height, name) for name, height in order.items()][:MOST_BOXES])
        bare = cls(float(values[0]), float(values[-1]), {}, ())
        marked = values if len(values) <= FEW_TICKS else np.linspace(bare.lowest, bare.highest, FEW_TICKS).tolist()
        return replace(bare, ticks=[(bare.height(value), f"{value:.4g}") for value in marked])

    def height(self, value: Any) -> float:
        if self.order:
            return self.order[text(value)]
        return (value - self.lowest) / (self.highest - self.lowest) if self.highest > self.lowest else 0.5


def _hover_text(row: Mapping[str, Any], keys: Sequence[str]) -> str:
    return ", ".join(f"{words(key) if key in ERRORS else key} {text(row[key])}" for key in keys)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
