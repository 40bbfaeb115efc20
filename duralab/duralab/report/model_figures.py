"""Figures of the identified model: frequency responses with their uncertainty, coherence, nonlinearity."""

from __future__ import annotations

import numpy as np

from duralab.data import Distortion, Model, excited_lines
from duralab.report.drawing import Figure, axes, band_edges, channel_color, frequency_axis, line
from duralab.report.series import encode


def contributions(model: Model, band: tuple[float, float]) -> np.ndarray:
    """Return the share of each response's RMS that each drive caused in the experiment."""
    lines = (model.frequency >= band[0]) & (model.frequency <= band[1])
    # A line of the band without an estimate (NaN) adds nothing.
    caused = np.nansum(np.abs(model.frf[lines]) ** 2 * model.drive_psd[lines][:, np.newaxis, :], axis=0)
    whole = np.sum(model.response_psd[lines], axis=0)
    return np.sqrt(caused / np.where(whole > 0, whole, np.nan)[:, np.newaxis])


def model_element(model: Model, response: int, drive: int, *, band: tuple[float, float]) -> Figure:
    """Return the figure of magnitude with uncertainty, phase and coherence of one element of the FRF matrix."""
    lines = excited_lines(model)
    frequency, element = encode(model.frequency[lines]), model.frf[lines, response, drive]
    deviation = np.nan_to_num(model.frf_deviation[lines, response, drive])
    # Two deviations of the complex element to either side; the lower limit is at least a tenth of the magnitude.
    largest = np.abs(element) + 2.0 * deviation
    smallest = np.maximum(np.abs(element) - 2.0 * deviation, 0.1 * np.abs(element))
    y, u = model.responses[response], model.drives[drive]

    def trace(name: str, values: np.ndarray, *, axis: str = "y", color: str = "@last", **more: str) -> Figure:
        place = {"x": frequency, "y": encode(values), "xaxis": "x", "yaxis": axis}
        return line(name, color, width=1.6) | place | more | {"showlegend": False}

    return {
        "data": [
            trace("upper limit (2 σ)", largest, color="@line", hoverinfo="skip"),
            trace("lower limit (2 σ)", smallest, color="@line", hoverinfo="skip", fill="tonexty"),
            trace("magnitude", np.abs(element)),
            trace("phase", np.degrees(np.angle(element)), axis="y2"),
            trace("coherence", model.coherence[lines, response], axis="y3", color="@error"),
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
    """Return the figure of the multiple coherence of every response."""
    lines = excited_lines(model)
    data = [
        line(
            channel.title,
            channel_color(row),
            x=encode(model.frequency[lines]),
            y=encode(model.coherence[lines, row]),
        )
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
    """Return the figure of the condition number of the drives' cross-spectrum; near 1 the drives are well separated."""
    lines = excited_lines(model)
    return {
        "data": [
            line(
                "condition number",
                "@last",
                x=encode(model.frequency[lines]),
                y=encode(model.condition_number[lines]),
            )
        ],
        "layout": {
            "xaxis": frequency_axis(),
            "yaxis": {"title": {"text": "condition number of the drives"}, "rangemode": "tozero"},
            "shapes": band_edges(band),
        },
    }


def nonlinearity(model: Model, found: Distortion, response: int, *, band: tuple[float, float]) -> Figure:
    """Return the figure of the density of one response in the experiment, of its nonlinear part and of its noise."""
    excited, channel = excited_lines(model), model.responses[response]
    curves = [
        ("response", "@target", model.response_psd),
        ("nonlinear", "@error", found.distortion_psd),
        ("nonlinear, odd orders", "@best", found.odd_distortion_psd),
        ("nonlinear, even orders", "@first", found.even_distortion_psd),
        ("noise", "@muted", found.noise_psd),
    ]
    data, top = [], 1e-300
    for name, color, density in curves:
        if not density.size:
            continue
        # A difference of two estimates may be below 0 without distortion; the detection lines are not excited.
        drawn = density[:, response] > 0.0
        drawn &= excited if density is model.response_psd else model.frequency > 0.0
        if drawn.any():
            data.append(line(name, color, x=encode(model.frequency[drawn]), y=encode(density[drawn, response])))
            top = max(top, float(density[drawn, response].max()))
    layout = axes(x="", y=f"[{channel.unit}²/Hz]", shapes=band_edges(band))
    layout["xaxis"] = frequency_axis()
    layout["yaxis"] |= {"type": "log", "range": [np.log10(top) - 7.0, np.log10(top) + 0.3]}
    return {"data": data, "layout": layout}
