"""Drawings of the live view that need axes of their own: the FRF over frequency, which is no time series.

Everything is placed on a canvas in pixels with y downwards, as the viewer's two-dimensional views want it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from recorder.live_series import Colour, colour_of

Strip: TypeAlias = np.ndarray
"""Shape (points, 2): x, y on the canvas."""

_FRAME: Colour = (120, 120, 120)
_GRID: Colour = (62, 62, 62)
_LABEL: Colour = (150, 150, 150)
_LABEL_DROP = 12.0

CANVAS: Final = (1600.0, 1000.0)
"""Width and height."""


@dataclass(frozen=True)
class Axes:
    """A rectangle of the canvas with a logarithmic frequency axis.

    Parameters
    ----------
    left, top, width, height : float
        Place on the canvas.
    frequencies : tuple of float
        Ends of the frequency axis, in hertz, greater than 0.
    values : tuple of float
        Ends of the value axis: of log10(value) where `decades`, else of the value itself.
    decades : bool
        Whether the value axis is logarithmic.
    """

    left: float
    top: float
    width: float
    height: float
    frequencies: tuple[float, float]
    values: tuple[float, float]
    decades: bool

    def place(self, frequency: np.ndarray, value: np.ndarray) -> Strip:
        """Return where points fall on the canvas; values of 0 on a logarithmic axis are NaN."""
        low, high = np.log10(self.frequencies)
        x = self.left + self.width * (np.log10(frequency) - low) / (high - low)
        scaled = np.log10(np.where(value > 0, value, np.nan)) if self.decades else value
        bottom, top = self.values
        y = self.top + self.height * (1 - (scaled - bottom) / (top - bottom))
        return np.column_stack([x, y])


@dataclass
class Drawing:
    """Lines and labels, collected."""

    strips: list[Strip] = field(default_factory=list)
    strip_colours: list[Colour] = field(default_factory=list)
    strip_widths: list[float] = field(default_factory=list)
    label_places: list[tuple[float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    label_colours: list[Colour] = field(default_factory=list)

    def line(self, strip: Strip, *, colour: Colour, width: float) -> None:
        """Add a line, broken where its points are not finite."""
        finite = np.asarray(np.isfinite(strip).all(axis=1))
        for piece in np.split(np.arange(len(strip)), np.flatnonzero(np.diff(finite)) + 1):
            if len(piece) > 1 and finite[piece[0]]:
                self.strips.append(strip[piece])
                self.strip_colours.append(colour)
                self.strip_widths.append(width)

    def label(self, x: float, y: float, text: str, *, colour: Colour = _LABEL) -> None:
        """Add a text with its centre at a place."""
        # The viewer hangs a label below its point.
        self.label_places.append((x, y - _LABEL_DROP))
        self.labels.append(text)
        self.label_colours.append(colour)


def frequency_ticks(lowest: float, highest: float) -> list[float]:
    """Return the frequencies 1, 2, 5 × 10^n within a band."""
    decades = range(math.floor(math.log10(lowest)), math.ceil(math.log10(highest)) + 1)
    ticks = (digit * 10.0**decade for decade in decades for digit in (1, 2, 5))
    return [tick for tick in ticks if lowest * (1 - 1e-9) <= tick <= highest * (1 + 1e-9)]


def _tick_text(tick: float, *, decades: bool) -> str:
    return f"1e{math.log10(tick):.0f}" if decades else f"{tick:g}"


def _draw_axes(drawing: Drawing, axes: Axes, *, value_ticks: Sequence[float], frequency_labels: bool) -> None:
    right, bottom = axes.left + axes.width, axes.top + axes.height
    corners = [(axes.left, axes.top), (right, axes.top), (right, bottom), (axes.left, bottom), (axes.left, axes.top)]
    drawing.line(np.array(corners), colour=_FRAME, width=0.6)
    for tick in frequency_ticks(*axes.frequencies):
        x = float(axes.place(np.array([tick]), np.array([1.0]))[0, 0])
        drawing.line(np.array([(x, axes.top), (x, bottom)]), colour=_GRID, width=0.4)
        if frequency_labels:
            drawing.label(x, bottom + 15, f"{tick:g}")
    for tick in value_ticks:
        y = float(axes.place(np.array([axes.frequencies[0]]), np.array([tick]))[0, 1])
        drawing.line(np.array([(axes.left, y), (right, y)]), colour=_GRID, width=0.4)
        drawing.label(axes.left - 26, y, _tick_text(tick, decades=axes.decades))


def draw_frf(
    frequency: np.ndarray,
    frf: np.ndarray,
    coherence: np.ndarray,
    *,
    responses: Sequence[str],
    drives: Sequence[str],
    band: tuple[float, float],
) -> Drawing:
    """Draw the magnitude of an FRF matrix and the coherence, a panel for each response.

    Parameters
    ----------
    frequency : np.ndarray, shape (lines,)
        In hertz.
    frf : np.ndarray, shape (lines, responses, drives)
        Complex, response unit per drive unit.
    coherence : np.ndarray, shape (lines, responses)
        Multiple coherence, 0 to 1.
    responses, drives : sequence of str
        Names with units.
    band : tuple of float
        Lowest and highest frequency shown, in hertz, greater than 0.

    Returns
    -------
    Drawing
        On a canvas of `CANVAS`.
    """
    drawing = Drawing()
    shown = (frequency >= band[0]) & (frequency <= band[1]) & (frequency > 0)
    lines = frequency[shown]
    if len(lines) < 2:
        return drawing
    ends = (float(lines[0]), float(lines[-1]))
    columns = max(1, math.ceil(math.sqrt(len(responses))))
    rows = math.ceil(len(responses) / columns)
    header = 50.0
    width, height = CANVAS[0] / columns, (CANVAS[1] - header) / rows
    for index, response in enumerate(responses):
        left, top = (index % columns) * width + 70, (index // columns) * height + header + 34
        magnitude = np.abs(frf[shown, index, :])
        _draw_magnitude(drawing, lines, magnitude, place=(left, top, width - 90, height * 0.58), ends=ends)
        axes = Axes(left, top + height * 0.65, width - 90, height * 0.16, ends, (0.0, 1.0), decades=False)
        _draw_axes(drawing, axes, value_ticks=(0.0, 0.5, 1.0), frequency_labels=True)
        drawing.line(axes.place(lines, coherence[shown, index]), colour=(210, 210, 210), width=1.0)
        drawing.label(left + (width - 90) / 2, top - 16, f"|H| to {response}, coherence below")
        drawing.label(left + (width - 90) / 2, axes.top + axes.height + 36, "frequency [Hz]")
    for index, drive in enumerate(drives):
        x = CANVAS[0] * (index + 0.5) / len(drives)
        drawing.label(x, 18, f"from {drive}", colour=colour_of(index))
    return drawing


def _draw_magnitude(
    drawing: Drawing,
    frequency: np.ndarray,
    magnitude: np.ndarray,
    *,
    place: tuple[float, float, float, float],
    ends: tuple[float, float],
) -> None:
    usable = magnitude[np.isfinite(magnitude) & (magnitude > 0)]
    if usable.size == 0:
        return
    low, high = math.floor(np.log10(usable.min())), math.ceil(np.log10(usable.max()))
    axes = Axes(*place, ends, (low, max(high, low + 1)), decades=True)
    ticks = [10.0**decade for decade in range(low, max(high, low + 1) + 1)]
    _draw_axes(drawing, axes, value_ticks=ticks, frequency_labels=False)
    for index in range(magnitude.shape[1]):
        drawing.line(axes.place(frequency, magnitude[:, index]), colour=colour_of(index), width=1.2)
