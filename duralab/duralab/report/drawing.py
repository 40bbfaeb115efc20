"""Drawing of the report's figures: plain data for plotly.js, in the colours of the page's theme."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

Figure = dict[str, Any]
"""Plotly figure, or a part of one, as plain data; a colour "@name" is a colour of the page's theme."""

COLORS: Final = 8
"""Number of the theme's channel colours, from "@channel-0"; more channels repeat them."""

SYMBOLS: Final = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon")

FREQUENCY_TICKS: Final = [m * 10.0**e for e in range(-2, 4) for m in (1, 2, 5)]


def channel_color(row: int) -> str:
    """Return the colour of a channel, or of a recording, by its index."""
    return f"@channel-{row % COLORS}"


def line(name: str, color: str, *, width: float = 1.4, dash: str = "solid", **curve: object) -> Figure:
    """Return a curve; `curve` holds its x and y and other attributes of plotly.js."""
    style = {"color": color, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "name": name, "line": style, **curve}


def markers(row: int, name: str, *, x: Sequence[int], y: np.ndarray) -> Figure:
    """Return points joined by lines, with colour and symbol by `row`."""
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": name.replace("_", " "),
        "x": list(x),
        # A monitored channel without a target has NaN, which JSON does not support.
        "y": [float(value) if np.isfinite(value) else None for value in y],
        "line": {"color": channel_color(row), "width": 1.5},
        "marker": {"symbol": SYMBOLS[row % len(SYMBOLS)], "size": 7},
    }


def axes(*, x: str, y: str, **more: object) -> Figure:
    """Return a layout with the titles of both axes."""
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}, **more}


def over_playbacks(title: str, numbers: Sequence[int]) -> Figure:
    """Return the layout of a figure over the playbacks."""
    step = max(1, len(numbers) // 12)
    layout = axes(x="playback", y=title)
    layout["xaxis"] |= {"tickmode": "array", "tickvals": list(numbers)[::step]}
    return layout


def frequency_axis() -> Figure:
    """Return a logarithmic axis with the ticks 1, 2, 5 and their decades."""
    ticks = {"tickmode": "array", "tickvals": FREQUENCY_TICKS, "ticktext": [f"{tick:g}" for tick in FREQUENCY_TICKS]}
    return {"title": {"text": "frequency [Hz]"}, "type": "log", **ticks}


def band_edges(band: tuple[float, float]) -> list[Figure]:
    """Return lines at the edges of the control band."""
    style = {"color": "@muted", "width": 1, "dash": "dash"}
    return [{"type": "line", "x0": edge, "x1": edge, "yref": "paper", "y0": 0, "y1": 1, "line": style} for edge in band]


def level_line(value: float, color: str = "@muted") -> Figure:
    """Return a dashed line across the figure."""
    style = {"color": color, "width": 1, "dash": "dash"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value, "line": style}


def level_note(value: float, text: str, color: str = "@muted") -> Figure:
    """Return a text on a `level_line` at its right end."""
    place = {"xref": "paper", "x": 1, "xanchor": "right", "y": value, "yanchor": "bottom", "showarrow": False}
    return {**place, "text": text, "font": {"color": color, "size": 11}}
