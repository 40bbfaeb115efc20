"""Figures of signals: target and response over time, their spectra, and the drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

import spectra
from duralab.recording_content import Playback
from duralab.report.series import encode, thin_out
from duralab.signals import Signals

Figure = dict[str, Any]
"""A plotly figure as plain data; a colour "@name" is a colour of the page's theme."""

ZOOM_SECONDS: Final = 2.0
"""Length of the window that is shown at the full sample rate."""

SHOWN_BEYOND_BAND: Final = 1.4
"""How far spectra are drawn beyond the control band, as a factor on its edges."""

SPECTRUM_OVERLAP: Final = 0.5

DRAWN_LIMIT: Final = 3.0
"""A limit is drawn where it is below this multiple of the drive's peak; farther off it would flatten the curve."""

FREQUENCY_TICKS: Final = [m * 10.0**e for e in range(-2, 4) for m in (1, 2, 5)]


def frequency_axis() -> Figure:
    """Return a logarithmic axis with the ticks 1, 2, 5 and their decades."""
    ticks = {"tickmode": "array", "tickvals": FREQUENCY_TICKS, "ticktext": [f"{tick:g}" for tick in FREQUENCY_TICKS]}
    return {"title": {"text": "frequency [Hz]"}, "type": "log", **ticks}


@dataclass(frozen=True, eq=False)
class Shown:
    """Target and playbacks that the report shows.

    Parameters
    ----------
    target : Signals
        In the control band.
    first, best, last : Playback
        Some may be the same one.
    band : tuple of float
        Lower and upper edge of the control band, in hertz.
    block_samples : int
        Samples in a block of the spectra.
    """

    target: Signals
    first: Playback
    best: Playback
    last: Playback
    band: tuple[float, float]
    block_samples: int

    @property
    def curves(self) -> list[tuple[str, str, Playback]]:
        """Title, colour and playback of each different one, the last on top."""
        curves = [(f"playback {self.first.number}", "@first", self.first)]
        if self.best.number not in (self.first.number, self.last.number):
            curves.append((f"playback {self.best.number} (best)", "@best", self.best))
        if self.last.number != self.first.number:
            best = ", best" if self.last.number == self.best.number else ""
            curves.append((f"playback {self.last.number} (last{best})", "@last", self.last))
        return curves


def _line(name: str, color: str, *, width: float = 1.4, dash: str = "solid", **curve: object) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "line": {"color": color, "width": width, "dash": dash},
        **curve,
    }


def _layout(*, x: str, y: str, **more: object) -> Figure:
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}, **more}


def waveform(shown: Shown, row: int) -> Figure:
    """Target and responses of one channel over the whole length, and below them what is left between them."""
    channel, rate = shown.target.channels[row], shown.target.sample_rate

    def curve(samples: np.ndarray) -> Figure:
        return thin_out(samples, sample_rate=rate, highest_frequency=shown.band[1]).to_plotly()

    wanted, last = shown.target.samples[row], shown.last.response_in_band.samples[row]
    data = [_line("target", "@target", width=1.8, **curve(wanted))]
    for name, color, playback in shown.curves:
        # Playbacks before the last are there to compare with: a click on the name shows them.
        visible = True if playback is shown.last else "legendonly"
        data.append(_line(name, color, visible=visible, **curve(playback.response_in_band.samples[row])))
    data.append(_line(f"error of playback {shown.last.number}", "@error", yaxis="y2", **curve(wanted - last)))
    span = 1.05 * float(np.abs(wanted).max())
    layout = _layout(x="time [s]", y=f"{channel.title} [{channel.unit}]")
    layout["xaxis"] |= {"anchor": "y2"}
    layout["yaxis"] |= {"domain": [0.38, 1.0]}
    # The same scale as above would show nothing of a good result; a third of the target's peak shows both.
    layout["yaxis2"] = {"domain": [0.0, 0.31], "range": [-span / 3, span / 3], "title": {"text": "error"}}
    return {"data": data, "layout": layout}


def zoom_window(target: Signals) -> slice:
    """Return the samples around the largest peak of the target, relative to its channel's RMS."""
    level = spectra.rms(target.samples)[:, np.newaxis]
    # The target of a watched channel may be silent.
    relative = np.divide(np.abs(target.samples), level, out=np.zeros_like(target.samples), where=level > 0.0)
    centre = int(np.argmax(relative.max(axis=0)))
    length = min(target.samples.shape[1], round(ZOOM_SECONDS * target.sample_rate))
    start = min(max(0, centre - length // 2), target.samples.shape[1] - length)
    return slice(start, start + length)


def zoomed_waveform(shown: Shown, row: int) -> Figure:
    """Target and responses of one channel around the target's largest peak, every sample."""
    channel, rate, window = shown.target.channels[row], shown.target.sample_rate, zoom_window(shown.target)
    grid = {"x0": window.start / rate, "dx": 1 / rate}
    data = [_line("target", "@target", width=2.2, y=encode(shown.target.samples[row, window]), **grid)]
    data += [
        _line(
            name,
            color,
            dash="dot" if color == "@first" else "solid",
            y=encode(playback.response_in_band.samples[row, window]),
            **grid,
        )
        for name, color, playback in shown.curves
    ]
    return {"data": data, "layout": _layout(x="time [s]", y=f"[{channel.unit}]")}


def spectrum(shown: Shown) -> list[Figure]:
    """Power spectral densities of target, responses and the last error, one figure for each channel."""
    samples, rate = shown.target.samples.shape[1], shown.target.sample_rate
    block = min(shown.block_samples, samples - samples % 2)

    def density(values: np.ndarray) -> np.ndarray:
        return spectra.auto_spectra(values, block_samples=block, overlap=SPECTRUM_OVERLAP, sample_rate=rate)

    frequency = np.arange(block // 2 + 1) * rate / block
    lines = (frequency >= shown.band[0] / SHOWN_BEYOND_BAND) & (frequency <= shown.band[1] * SHOWN_BEYOND_BAND)
    lines &= frequency > 0
    curves = [("target", "@target", "solid", density(shown.target.samples))]
    curves += [
        (name, color, "dot" if color == "@first" else "solid", density(playback.response_in_band.samples))
        for name, color, playback in shown.curves
    ]
    error = shown.target.samples - shown.last.response_in_band.samples
    curves.append((f"error of playback {shown.last.number}", "@error", "solid", density(error)))
    figures = []
    for row, channel in enumerate(shown.target.channels):
        # Five decades below the target there is nothing to compare: leave the filter's floor out of the picture.
        top = float(np.log10(max(values[lines, row].max() for _, _, _, values in curves if values[lines, row].any())))
        data = [
            _line(
                name,
                color,
                dash=dash,
                width=2.2 if color == "@target" else 1.3,
                x=encode(frequency[lines]),
                y=encode(values[lines, row]),
            )
            for name, color, dash, values in curves
        ]
        layout = _layout(x="frequency [Hz]", y=f"[{channel.unit}²/Hz]")
        layout["xaxis"] = frequency_axis()
        layout["yaxis"] |= {"type": "log", "range": [top - 5, top + 0.3], "dtick": 1}
        layout["shapes"] = band_edges(shown.band)
        figures.append({"data": data, "layout": layout})
    return figures


def band_edges(band: tuple[float, float]) -> list[Figure]:
    """Return lines at the edges of the control band."""
    return [
        {
            "type": "line",
            "x0": edge,
            "x1": edge,
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "line": {"color": "@muted", "width": 1, "dash": "dash"},
        }
        for edge in band
    ]


def drive(shown: Shown, row: int) -> Figure:
    """Return the last drive of one actuator over the whole length, with its limits where it comes near them."""
    signals = shown.last.drive
    channel = signals.channels[row]
    # Actuators move by millimetres; everything else stays in its own unit.
    factor, unit = (1000.0, "mm") if channel.unit == "m" else (1.0, channel.unit)
    samples = factor * signals.samples[row]
    curve = thin_out(samples, sample_rate=signals.sample_rate, highest_frequency=shown.band[1])
    peak = float(np.abs(samples).max())
    limits = [factor * limit for limit in (channel.minimum, channel.maximum)]
    shapes = [
        {
            "type": "line",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "y0": limit,
            "y1": limit,
            "line": {"color": "@error", "width": 1, "dash": "dash"},
        }
        for limit in limits
        if abs(limit) < DRAWN_LIMIT * peak
    ]
    layout = _layout(x="time [s]", y=f"{channel.title} [{unit}]", shapes=shapes)
    return {"data": [_line(f"drive of playback {shown.last.number}", "@last", **curve.to_plotly())], "layout": layout}
