"""Axes, grids and labels of drawings that are not time series.

Positions are in pixels of a canvas with y downwards, as in the viewer's two-dimensional views.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from recorder.live.series import Colour

Strip: TypeAlias = np.ndarray
"""Shape (points, 2): x, y on the canvas."""

_FRAME: Colour = (120, 120, 120)
_GRID: Colour = (62, 62, 62)
_LABEL: Colour = (150, 150, 150)
_LABEL_DROP = 12.0

CANVAS: Final = (1600.0, 1000.0)
"""Width and height of the canvas in pixels."""


@dataclass(frozen=True)
class Axes:
    """A rectangle of the canvas with a logarithmic frequency axis.

    `left`, `top`, `width`, `height`: Place on the canvas. `frequencies`: Ends of the frequency axis, in hertz, greater
    than 0. `values`: Ends of the value axis, as log10(value) if `decades`. `decades`: Whether the value axis is
    logarithmic.
    """

    left: float
    top: float
    width: float
    height: float
    frequencies: tuple[float, float]
    values: tuple[float, float]
    decades: bool

    def place(self, frequency: np.ndarray, value: np.ndarray) -> Strip:
        """Return the positions of points on the canvas; values of 0 on a logarithmic axis are NaN."""
        low, high = np.log10(self.frequencies)
        x = self.left + self.width * (np.log10(frequency) - low) / (high - low)
        scaled = np.log10(np.where(value > 0, value, np.nan)) if self.decades else value
        bottom, top = self.values
        y = self.top + self.height * (1 - (scaled - bottom) / (top - bottom))
        return np.column_stack([x, y])


@dataclass
class Drawing:
    """Collection of lines and labels."""

    strips: list[Strip] = field(default_factory=list)
    strip_colours: list[Colour] = field(default_factory=list)
    strip_widths: list[float] = field(default_factory=list)
    label_places: list[tuple[float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    label_colours: list[Colour] = field(default_factory=list)

    def line(self, strip: Strip, *, colour: Colour, width: float) -> None:
        """Add a line, interrupted at points that are not finite."""
        finite = np.asarray(np.isfinite(strip).all(axis=1))
        for piece in np.split(np.arange(len(strip)), np.flatnonzero(np.diff(finite)) + 1):
            if len(piece) > 1 and finite[piece[0]]:
                self.strips.append(strip[piece])
                self.strip_colours.append(colour)
                self.strip_widths.append(width)

    def label(self, x: float, y: float, text: str, *, colour: Colour = _LABEL) -> None:
        """Add a text centred at a position."""
        # The viewer draws a label below its point.
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


def draw_axes(drawing: Drawing, axes: Axes, *, value_ticks: Sequence[float], frequency_labels: bool) -> None:
    """Draw a frame, a grid and its labels."""
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
