"""Report that compares several recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from duralab.analysis import Comparison, Recorded, compare
from duralab.data import DAMAGE_SLOPES
from duralab.report import comparison_figures, load_figures
from duralab.report.campaign_report import TONES
from duralab.report.drawing import Figure
from duralab.report.rendering import render, write_page
from duralab.report.tables import comparison_rows

if TYPE_CHECKING:
    from duralab.recording import Recording


def write_comparison(path: str | Path, recordings: Comparison | Sequence[str | Path | Recording | Recorded]) -> Path:
    """Write a report that overlays several recordings.

    Parameters
    ----------
    path : str or Path
        Path of the HTML file; an existing file is replaced when the new one is complete.
    recordings : Comparison or sequence of str, Path, Recording or Recorded
        Result of `compare`, or recordings for `compare`.

    Returns
    -------
    Path
        Path of the report.

    Raises
    ------
    InputError
        `compare` refuses the recordings, or `path` is a file of one of them.
    """
    comparison = recordings if isinstance(recordings, Comparison) else compare(*recordings)
    read = [file for entry in comparison.recordings for file in entry.recording.files]
    return write_page(path, lambda: render_comparison(comparison), read=read)


def render_comparison(comparison: Comparison) -> str:
    """Return the report as HTML; see `write_comparison`."""
    entries = comparison_figures.overlaid(comparison)
    elements = comparison_figures.model_elements(entries)
    figures: dict[str, Figure] = {
        "overall": comparison_figures.overall_error(comparison),
        **{f"damage-{slope}": comparison_figures.damage(comparison, slope) for slope in DAMAGE_SLOPES},
    }
    for row, channel in enumerate(comparison.channels):
        unit = entries[0].target.channels[entries[0].target.names.index(channel)].unit
        counted = comparison_figures.counted(entries, channel)
        figures[f"error-{row}"] = comparison_figures.channel_error(comparison, channel)
        figures[f"zoom-{row}"] = comparison_figures.waveform(entries, channel)
        figures[f"psd-{row}"] = comparison_figures.spectrum(entries, channel)
        figures[f"pairs-{row}"] = load_figures.range_pairs(counted, unit)
        figures[f"crossings-{row}"] = load_figures.level_crossings(counted, unit)
        figures[f"times-{row}"] = load_figures.time_at_level(counted, unit)
    for place, (response, drive) in enumerate(elements):
        figures[f"frf-{place}"] = comparison_figures.model_element(entries, response, drive)
    words = [channel.replace("_", " ") for channel in comparison.channels]
    return render(
        "comparison.html.j2",
        figures=figures,
        comparison=comparison,
        tones=[TONES[entry.verdict.judgement] for entry in comparison.recordings],
        channels=words,
        channel_options=list(enumerate(words)),
        rows=comparison_rows(comparison),
        slope_options=[(slope, f"k = {slope}") for slope in (5, 3, 8)],
        element_options=[
            (place, f"{response} over {drive}".replace("_", " ")) for place, (response, drive) in enumerate(elements)
        ],
    )
