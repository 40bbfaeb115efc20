"""The report of a sweep: one HTML file that opens offline."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.errors import InputError
from duralab.report import render, write_page
from duralab.sweeps import figures
from duralab.sweeps.campaign_task import CAMPAIGN
from duralab.sweeps.results import POINTS, SweepResults

MOST_ROWS: Final = 500
"""Points in the report's table, the best first; all of them are in results.parquet."""


def write_report(results: SweepResults, path: str | Path) -> Path:
    """Write the report of a sweep.

    Parameters
    ----------
    results : SweepResults
        What it came to.
    path : str or Path
        Where the HTML file goes; one that is there is replaced when the new one is complete.

    Returns
    -------
    Path
        Where it is.

    Raises
    ------
    InputError
        No point has ended yet, or the file cannot be written.
    """
    if not results.rows:
        raise InputError(f"No campaign of the sweep in {results.folder} has ended, so there is nothing to report.")
    return write_page(path, lambda: render_report(results))


def render_report(results: SweepResults) -> str:
    """Return the report as HTML; see `write_report`."""
    objective, best = results.objective.value, results.best
    keys = figures.varied(results)
    drawn = {f"axis-{row}": figures.along_axis(results, key) for row, key in enumerate(keys)}
    if results.finished:
        drawn["all"] = figures.parallel_coordinates(results)
    ranked = sorted(results.finished, key=lambda row: row[objective])
    return render(
        "page.html.j2",
        package="duralab.sweeps",
        figures=drawn,
        results=results,
        objective=figures.words(objective),
        keys=keys,
        best=best,
        best_settings=[(key, figures.text(best[key])) for key in results.keys] if best is not None else [],
        rerun=_rerun(best) if best is not None else "",
        rows=[_row(results, row, rank) for rank, row in enumerate(ranked[:MOST_ROWS], start=1)],
        summaries=[(key, _summary(results, key)) for key in keys],
        costs=_costs(results),
        text_of=figures.text,
        sweep_link=base64.b64encode(results.text.encode()).decode(),
        version=version("duralab"),
    )


def _rerun(best: Mapping[str, Any]) -> str:
    """Return the command that runs a point again, from the sweep's folder, with the same bytes."""
    place = f"{POINTS}/{best['id']}/{CAMPAIGN}"
    return f"duralab run {shlex.quote(place)} --out best"


def _row(results: SweepResults, row: Mapping[str, Any], rank: int) -> dict[str, Any]:
    recording = results.folder / POINTS / row["id"] / "recording.mcap"
    return {
        "rank": rank,
        "settings": [figures.text(row.get(key)) for key in results.keys],
        "overall": f"{row['overall_error']:.4f}",
        "worst": f"{row['worst_error']:.4f}",
        "playback": row["best_playback"],
        "judgement": row["judgement"],
        "seconds": f"{row['seconds_campaign']:.1f}",
        "id": row["id"],
        "recorded": recording.is_file(),
    }


def _summary(results: SweepResults, key: str) -> list[tuple[str, int, str, str, str]]:
    """Return for each value of a setting how many points have it, and the least, middle and greatest figure of them."""
    lines = []
    values = figures.ordered_values(results.finished, key)
    for value in values[: figures.MOST_BOXES]:
        found = [row[results.objective.value] for row in results.finished if row.get(key) == value]
        lines.append(
            (figures.text(value), len(found), f"{min(found):.4f}", f"{np.median(found):.4f}", f"{max(found):.4f}")
        )
    return lines if len(values) <= figures.MOST_BOXES else []


def _costs(results: SweepResults) -> list[tuple[str, str]]:
    def told(name: str) -> str:
        seconds = np.array([row[name] for row in results.rows if row[name] is not None])
        return f"{np.median(seconds):.2f} s in the middle, {seconds.max():.2f} s at most, {seconds.sum():.0f} s in all"

    size = sum(row["bytes"] or 0 for row in results.rows)
    return [
        ("Opening rig cells", told("seconds_cell")),
        ("Campaigns", told("seconds_campaign")),
        ("Processor time of the workers", told("seconds_processor")),
        ("Recordings", f"{size / 2**20:,.0f} MiB"),
    ]
