"""Figures of signals: target and response over time, their spectra, and the drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

import duralab_spectra
from duralab.data import Playback, Signals
from duralab.report.drawing import Figure, axes, band_edges, frequency_axis, level_line, line
from duralab.report.held_drives import HeldStretch
from duralab.report.series import encode, thin_out

ZOOM_SECONDS: Final = 2.0
"""Length of the window shown at the full sample rate."""

SHOWN_BEYOND_BAND: Final = 1.4
"""Factor on the edges of the control band up to which spectra are drawn."""

SPECTRUM_OVERLAP: Final = 0.5

SMALLEST_ERROR_SPAN: Final = 0.05
"""Smallest span of the error axis, as a share of the target's peak."""

DRAWN_STRETCHES: Final = 200
"""Maximum number of marked segments at a limit in a figure."""

DRAWN_LIMIT: Final = 3.0
"""A limit is drawn if it is below this multiple of the drive's peak; a larger one would flatten the curve."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Target and playbacks that the report shows.

    `target`: Target in the control band. `first`, `best`, `last`: Playbacks; some may be the same object. `band`: Lower
    and upper edge of the control band, in hertz. `block_samples`: Number of samples in a block of the spectra.
    """

    target: Signals
    first: Playback
    best: Playback
    last: Playback
    band: tuple[float, float]
    block_samples: int

    @property
    def curves(self) -> list[tuple[str, str, Playback]]:
        """Title, colour and playback of each different playback, the best on top."""
        curves = []
        if self.first is not self.best:
            curves.append((f"playback {self.first.number}", "@first", self.first))
        if self.last is self.best:
            alone = " (last, best)" if curves else ""
            return [*curves, (f"playback {self.best.number}{alone}", "@last", self.best)]
        if self.last is not self.first:
            curves.append((f"playback {self.last.number} (last)", "@last", self.last))
        return [*curves, (f"playback {self.best.number} (best)", "@best", self.best)]

    @property
    def first_and_best(self) -> list[tuple[str, str, Playback]]:
        """Curves without a last playback that is not the best."""
        return [curve for curve in self.curves if curve[2] is self.best or curve[2] is self.first]


def waveform(shown: Shown, row: int, held: Sequence[HeldStretch]) -> Figure:
    """Return the figure of target and responses of one channel over the whole length, with the error below."""
    channel, rate = shown.target.channels[row], shown.target.sample_rate

    def curve(samples: np.ndarray) -> Figure:
        return thin_out(samples, sample_rate=rate, highest_frequency=shown.band[1]).to_plotly()

    wanted, best = shown.target.samples[row], shown.best.response_in_band.samples[row]
    data = [line("target", "@target", width=1.8, **curve(wanted))]
    for name, color, playback in shown.curves:
        # The other playbacks are hidden at first; a click on the name shows them.
        visible = True if playback is shown.best else "legendonly"
        data.append(line(name, color, visible=visible, **curve(playback.response_in_band.samples[row])))
    data.append(line(f"error of playback {shown.best.number}", "@error", yaxis="y2", **curve(wanted - best)))
    # Scale the axis to the error, but at least to a twentieth of the target's peak, so that small errors look small.
    span = 1.05 * max(float(np.abs(wanted - best).max()), SMALLEST_ERROR_SPAN * float(np.abs(wanted).max()))
    layout = axes(x="time [s]", y=f"{channel.title} [{channel.unit}]")
    layout["xaxis"] |= {"anchor": "y2"}
    layout["yaxis"] |= {"domain": [0.38, 1.0]}
    layout["yaxis2"] = {"domain": [0.0, 0.31], "range": [-span, span], "title": {"text": f"error [{channel.unit}]"}}
    layout["shapes"] = held_bands(held)
    return {"data": data, "layout": layout}


def held_bands(held: Sequence[HeldStretch], *, drive: str | None = None) -> list[Figure]:
    """Return bands behind the curves where the given drive, or any, is at a limit; the first `DRAWN_STRETCHES` only."""
    style = {"type": "rect", "yref": "paper", "y0": 0, "y1": 1, "layer": "below", "fillcolor": "@held"}
    return [
        {**style, "x0": stretch.start, "x1": stretch.end, "line": {"width": 2, "color": "@held"}}
        for stretch in held
        if drive in (None, stretch.drive)
    ][:DRAWN_STRETCHES]


def zoom_window(target: Signals) -> slice:
    """Return the samples around the largest peak of the target, relative to its channel's RMS."""
    level = duralab_spectra.rms(target.samples)[:, np.newaxis]
    # The target of a monitored channel may be zero.
    relative = np.divide(np.abs(target.samples), level, out=np.zeros_like(target.samples), where=level > 0.0)
    centre = int(np.argmax(relative.max(axis=0)))
    length = min(target.samples.shape[1], round(ZOOM_SECONDS * target.sample_rate))
    start = min(max(0, centre - length // 2), target.samples.shape[1] - length)
    return slice(start, start + length)


def zoomed_waveform(shown: Shown, row: int) -> Figure:
    """Return the figure of target and responses of one channel around the target's largest peak, with every sample."""
    channel, rate, window = shown.target.channels[row], shown.target.sample_rate, zoom_window(shown.target)
    grid = {"x0": window.start / rate, "dx": 1 / rate}
    data = [line("target", "@target", width=2.2, y=encode(shown.target.samples[row, window]), **grid)]
    data += [
        line(
            name,
            color,
            dash="dot" if color == "@first" else "solid",
            y=encode(playback.response_in_band.samples[row, window]),
            **grid,
        )
        for name, color, playback in shown.curves
    ]
    return {"data": data, "layout": axes(x="time [s]", y=f"[{channel.unit}]")}


def spectrum(shown: Shown) -> list[Figure]:
    """Return a figure for each channel: power spectral densities of target, responses and the best playback's error."""
    samples, rate = shown.target.samples.shape[1], shown.target.sample_rate
    block = min(shown.block_samples, samples - samples % 2)

    def density(values: np.ndarray) -> np.ndarray:
        return duralab_spectra.auto_spectra(values, block_samples=block, overlap=SPECTRUM_OVERLAP, sample_rate=rate)

    frequency = np.arange(block // 2 + 1) * rate / block
    lines = (frequency >= shown.band[0] / SHOWN_BEYOND_BAND) & (frequency <= shown.band[1] * SHOWN_BEYOND_BAND)
    lines &= frequency > 0
    curves = [("target", "@target", "solid", density(shown.target.samples))]
    curves += [
        (name, color, "dot" if color == "@first" else "solid", density(playback.response_in_band.samples))
        for name, color, playback in shown.curves
    ]
    error = shown.target.samples - shown.best.response_in_band.samples
    curves.append((f"error of playback {shown.best.number}", "@error", "solid", density(error)))
    figures = []
    for row, channel in enumerate(shown.target.channels):
        # Omit the filter's floor, more than five decades below the maximum.
        top = float(np.log10(max(values[lines, row].max() for _, _, _, values in curves if values[lines, row].any())))
        data = [
            line(
                name,
                color,
                dash=dash,
                width=2.2 if color == "@target" else 1.3,
                x=encode(frequency[lines]),
                y=encode(values[lines, row]),
            )
            for name, color, dash, values in curves
        ]
        layout = axes(x="frequency [Hz]", y=f"[{channel.unit}²/Hz]")
        layout["xaxis"] = frequency_axis()
        layout["yaxis"] |= {"type": "log", "range": [top - 5, top + 0.3], "dtick": 1}
        layout["shapes"] = band_edges(shown.band)
        figures.append({"data": data, "layout": layout})
    return figures


def drive(shown: Shown, row: int, held: Sequence[HeldStretch]) -> Figure:
    """Return the best drive of one actuator over the whole length, with the limits that it comes near."""
    signals = shown.best.drive
    channel = signals.channels[row]
    # Displacements are shown in mm; other quantities keep their unit.
    factor, unit = (1000.0, "mm") if channel.unit == "m" else (1.0, channel.unit)
    samples = factor * signals.samples[row]
    curve = thin_out(samples, sample_rate=signals.sample_rate, highest_frequency=shown.band[1])
    peak = float(np.abs(samples).max())
    limits = [factor * limit for limit in (channel.minimum, channel.maximum)]
    shapes = [level_line(limit, "@error") for limit in limits if abs(limit) < DRAWN_LIMIT * peak]
    shapes += held_bands(held, drive=channel.name)
    layout = axes(x="time [s]", y=f"{channel.title} [{unit}]", shapes=shapes)
    return {"data": [line(f"drive of playback {shown.best.number}", "@last", **curve.to_plotly())], "layout": layout}
