"""Figures of numbers: convergence over the playbacks, the identified model, the use of the actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from duralab.iteration_table import IterationTable
from duralab.recording_content import ActuatorUse, Model
from duralab.report.series import encode
from duralab.report.waveforms import Figure, band_edges, frequency_axis

_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon")
_COLORS = 8

SMALLEST_LEVEL = 1e-3
"""A line whose drives have less than this share of the strongest line's level is not drawn."""


def _markers(index: int, name: str, *, x: Sequence[int], y: np.ndarray) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": name.replace("_", " "),
        "x": list(x),
        # The figure of a watched channel without a target is left out: a number that is none is no JSON either.
        "y": [float(value) if np.isfinite(value) else None for value in y],
        "line": {"color": f"@channel-{index % _COLORS}", "width": 1.5},
        "marker": {"symbol": _SYMBOLS[index % len(_SYMBOLS)], "size": 7},
    }


def _over_playbacks(title: str, numbers: Sequence[int]) -> Figure:
    step = max(1, len(numbers) // 12)
    return {
        "xaxis": {"title": {"text": "playback"}, "tickmode": "array", "tickvals": list(numbers)[::step]},
        "yaxis": {"title": {"text": title}},
    }


def _level(value: float, text: str, color: str = "@muted") -> tuple[list[Figure], list[Figure]]:
    shape = {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": {"color": color, "width": 1, "dash": "dash"},
    }
    note = {
        "xref": "paper",
        "x": 1,
        "xanchor": "right",
        "y": value,
        "yanchor": "bottom",
        "text": text,
        "showarrow": False,
        "font": {"color": color, "size": 11},
    }
    return [shape], [note]


def error_per_playback(table: IterationTable, *, limit: float | None) -> Figure:
    """Relative RMS error of every channel after every playback."""
    columns = zip(table.channels, table.relative_rms_error.T, strict=True)
    data = [_markers(i, name, x=table.numbers, y=column) for i, (name, column) in enumerate(columns)]
    layout = _over_playbacks("relative RMS error", table.numbers)
    layout["yaxis"]["rangemode"] = "tozero"
    if limit is not None:
        layout["shapes"], layout["annotations"] = _level(limit, f"accepted: {limit:g}")
    return {"data": data, "layout": layout}


def response_per_playback(table: IterationTable) -> Figure:
    """RMS response of every channel after every playback."""
    columns = zip(table.channels, table.rms_response.T, strict=True)
    data = [_markers(i, name, x=table.numbers, y=column) for i, (name, column) in enumerate(columns)]
    layout = _over_playbacks("RMS response", table.numbers)
    layout["shapes"], layout["annotations"] = _level(1.0, "target")
    return {"data": data, "layout": layout}


def actuator_use_per_playback(actuators: Sequence[Sequence[ActuatorUse]], numbers: Sequence[int]) -> Figure:
    """Peak of every drive over its limit, for every playback."""
    data = [
        _markers(i, use.drive, x=numbers, y=np.array([100 * uses[i].peak_command_ratio for uses in actuators]))
        for i, use in enumerate(actuators[0])
    ]
    layout = _over_playbacks("peak of the drive [% of its limit]", numbers)
    layout["yaxis"]["range"] = [0, 105]
    layout["shapes"], layout["annotations"] = _level(100.0, "limit", "@error")
    return {"data": data, "layout": layout}


def _lines(model: Model) -> np.ndarray:
    """Return which lines were excited: elsewhere the estimate is noise over noise, or left at zero."""
    level = np.nan_to_num(model.drive_psd).max(axis=1)
    estimated = np.abs(np.nan_to_num(model.frf)).max(axis=(1, 2)) > 0
    return (level > SMALLEST_LEVEL * level.max()) & estimated & (model.frequency > 0)


def contributions(model: Model, band: tuple[float, float]) -> np.ndarray:
    """Return how much of each response's RMS each drive caused in the experiment.

    Returns
    -------
    np.ndarray, shape (responses, drives)
        sqrt(sum |H_ij|² S_uu,jj / sum S_yy,ii) over the lines in the band, about 0 to 1.
    """
    lines = (model.frequency >= band[0]) & (model.frequency <= band[1])
    caused = np.sum(np.abs(model.frf[lines]) ** 2 * model.drive_psd[lines][:, np.newaxis, :], axis=0)
    whole = np.sum(model.response_psd[lines], axis=0)
    return np.sqrt(caused / np.where(whole > 0, whole, np.nan)[:, np.newaxis])


def model_element(model: Model, response: int, drive: int, *, band: tuple[float, float]) -> Figure:
    """Magnitude with its uncertainty, phase and coherence of one element of the FRF matrix."""
    lines = _lines(model)
    frequency, element = encode(model.frequency[lines]), model.frf[lines, response, drive]
    deviation = np.nan_to_num(model.frf_deviation[lines, response, drive])
    # Two deviations of the complex element to either side; a tenth of the magnitude is as far down as the axis goes.
    largest = np.abs(element) + 2.0 * deviation
    smallest = np.maximum(np.abs(element) - 2.0 * deviation, 0.1 * np.abs(element))
    y, u = model.responses[response], model.drives[drive]

    def trace(values: np.ndarray, axis: str, color: str) -> Figure:
        return {
            "type": "scatter",
            "mode": "lines",
            "x": frequency,
            "y": encode(values),
            "xaxis": "x",
            "yaxis": axis,
            "line": {"color": color, "width": 1.6},
            "showlegend": False,
        }

    return {
        "data": [
            trace(largest, "y", "@line") | {"name": "upper limit (2 σ)", "hoverinfo": "skip"},
            trace(smallest, "y", "@line") | {"name": "lower limit (2 σ)", "hoverinfo": "skip", "fill": "tonexty"},
            trace(np.abs(element), "y", "@last") | {"name": "magnitude"},
            trace(np.degrees(np.angle(element)), "y2", "@last") | {"name": "phase"},
            trace(model.coherence[lines, response], "y3", "@error") | {"name": "coherence"},
        ],
        "layout": {
            "title": {
                "text": f"{y.title} force over {u.title} drive" if y.unit == "N" else f"{y.title} over {u.title}"
            },
            "xaxis": frequency_axis() | {"anchor": "y3"},
            "yaxis": {
                "domain": [0.52, 1.0],
                "type": "log",
                "title": {"text": f"magnitude<br>[{y.unit}/{u.unit}]"},
                "exponentformat": "power",
                "dtick": "D2",
            },
            "yaxis2": {
                "domain": [0.26, 0.47],
                "range": [-190, 190],
                "tickvals": [-180, -90, 0, 90, 180],
                "title": {"text": "phase [°]"},
            },
            "yaxis3": {"domain": [0.0, 0.21], "range": [0, 1.05], "title": {"text": "coherence"}},
            "shapes": band_edges(band),
            "hovermode": "x",
        },
    }


def coherence(model: Model, *, band: tuple[float, float]) -> Figure:
    """Multiple coherence of every response."""
    lines = _lines(model)
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": channel.title,
            "x": encode(model.frequency[lines]),
            "y": encode(model.coherence[lines, row]),
            "line": {"color": f"@channel-{row % _COLORS}", "width": 1.4},
        }
        for row, channel in enumerate(model.responses)
    ]
    return {
        "data": data,
        "layout": {
            "xaxis": frequency_axis(),
            "yaxis": {"title": {"text": "multiple coherence"}, "range": [0, 1.05]},
            "shapes": band_edges(band),
        },
    }


def condition_number(model: Model, *, band: tuple[float, float]) -> Figure:
    """Condition number of the drives' cross-spectrum: near 1, the drives are told apart well."""
    lines = _lines(model)
    return {
        "data": [
            {
                "type": "scatter",
                "mode": "lines",
                "name": "condition number",
                "x": encode(model.frequency[lines]),
                "y": encode(model.condition_number[lines]),
                "line": {"color": "@last", "width": 1.6},
                "showlegend": False,
            }
        ],
        "layout": {
            "xaxis": frequency_axis(),
            "yaxis": {"title": {"text": "condition number of the drives"}, "rangemode": "tozero"},
            "shapes": band_edges(band),
        },
    }
