"""Small line charts as inline SVG, for offline use, on light and dark pages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from duralab_spectra import drawn_points

WIDTH: Final = 720
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 12, 22, 34
# Distinguishable with colour blindness, on black and on white.
COLORS: Final = ("#3b82c4", "#d9822b", "#3fa06c", "#b565a7", "#c94f4f", "#8a7a3d", "#5f9ea0", "#888888")
_MOST_TICKS: Final = 6


@dataclass(frozen=True, eq=False)
class Curve:
    """Curve of a chart.

    `name`: Name in the legend; no entry if empty. `x`, `y`, shape (points): Coordinates; points that are not finite, or
    not above 0 on a logarithmic axis, are omitted.
    """

    name: str
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Axis:
    """Title of an axis, and whether it is logarithmic.

    `title`: Quantity and unit. `logarithmic`: Whether the scale is logarithmic.
    """

    title: str
    logarithmic: bool = False


@dataclass(frozen=True)
class _Scale:
    low: float
    high: float
    logarithmic: bool

    def place(self, values: np.ndarray) -> np.ndarray:
        low, high = self._of(np.array([self.low, self.high]))
        return (self._of(values) - low) / (high - low)

    def _of(self, values: np.ndarray) -> np.ndarray:
        return np.log10(values) if self.logarithmic else values

    def ticks(self) -> list[float]:
        if self.logarithmic:
            first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
            step = max(1, math.ceil((last - first + 1) / _MOST_TICKS))
            between = (1.0, 2.0, 5.0) if last - first <= 2 else (1.0,)
            ticks = [10.0**power * part for power in range(first, last + 1, step) for part in between]
            inside = [tick for tick in ticks if self.low <= tick <= self.high]
            return inside if len(inside) > 1 else [self.low, self.high]
        rough = (self.high - self.low) / _MOST_TICKS
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= rough * (1.0 - 1e-9))
        return [step * number for number in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]


def line_chart(
    curves: Sequence[Curve], *, x: Axis, y: Axis, title: str = "", height: int = 220, from_zero: bool = False
) -> str:
    """Return a chart of several curves as an SVG element.

    `curves`: Curves; one with far more points than columns is drawn by the smallest and largest value of each column.
    `x`, `y`: Axes. `title`: Title above the chart. `height`: Height in pixels, for a width of 720. `from_zero`: Whether
    the vertical axis includes 0.
    Returns: SVG element.
    """
    shown = [_drawable(curve, x=x, y=y) for curve in curves]
    if not any(curve.x.size for curve in shown):
        return f"<p>{escape(title)}: no values to draw.</p>"
    across = _scale(np.concatenate([curve.x for curve in shown]), logarithmic=x.logarithmic)
    up = _scale(np.concatenate([curve.y for curve in shown]), logarithmic=y.logarithmic, from_zero=from_zero)
    parts = [*_axes(across, up, x=x, y=y, height=height)]
    for number, curve in enumerate(shown):
        color = COLORS[number % len(COLORS)]
        parts.append(_path(curve, across=across, up=up, height=height, color=color))
    if title:
        parts.append(f'<text x="{_LEFT}" y="14" font-weight="bold">{escape(title)}</text>')
    parts.append(_legend(shown))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'style="max-width:{WIDTH}px;width:100%;display:block" font-family="sans-serif" font-size="11" '
        f'fill="currentColor"><title>{escape(title or y.title)}</title>{"".join(parts)}</svg>'
    )


def _drawable(curve: Curve, *, x: Axis, y: Axis) -> Curve:
    kept = np.isfinite(curve.x) & np.isfinite(curve.y)
    kept &= (not x.logarithmic) | (curve.x > 0.0)
    kept &= (not y.logarithmic) | (curve.y > 0.0)
    across, up = curve.x[kept], curve.y[kept]
    columns = WIDTH - _LEFT - _RIGHT
    if across.size > 4 * columns:
        chosen = drawn_points(up, -(-up.size // columns))
        across, up = across[chosen], up[chosen]
    return Curve(curve.name, across, up)


def _scale(values: np.ndarray, *, logarithmic: bool, from_zero: bool = False) -> _Scale:
    low, high = float(values.min()), float(values.max())
    if from_zero:
        low = min(low, 0.0)
    if low == high:
        low, high = (low / 2.0, high * 2.0) if logarithmic else (low - 1.0, high + 1.0)
    return _Scale(low, high, logarithmic)


def _x(share: float) -> float:
    return _LEFT + share * (WIDTH - _LEFT - _RIGHT)


def _y(share: float, height: int) -> float:
    return height - _BOTTOM - share * (height - _TOP - _BOTTOM)


def _axes(across: _Scale, up: _Scale, *, x: Axis, y: Axis, height: int) -> list[str]:
    bottom, parts = _y(0.0, height), []
    for tick in across.ticks():
        place = _x(float(across.place(np.array([tick]))[0]))
        parts.append(f'<line x1="{place:.1f}" x2="{place:.1f}" y1="{_TOP}" y2="{bottom}" stroke-opacity="0.15"/>')
        parts.append(f'<text x="{place:.1f}" y="{bottom + 13}" text-anchor="middle" stroke="none">{tick:.4g}</text>')
    for tick in up.ticks():
        place = _y(float(up.place(np.array([tick]))[0]), height)
        right = WIDTH - _RIGHT
        parts.append(f'<line x1="{_LEFT}" x2="{right}" y1="{place:.1f}" y2="{place:.1f}" stroke-opacity="0.15"/>')
        parts.append(f'<text x="{_LEFT - 5}" y="{place + 4:.1f}" text-anchor="end" stroke="none">{tick:.4g}</text>')
    grid = f'<g stroke="currentColor">{"".join(parts)}</g>'
    middle = (_TOP + bottom) / 2
    return [
        grid,
        f'<text x="{(_LEFT + WIDTH - _RIGHT) / 2}" y="{height - 5}" text-anchor="middle">{escape(x.title)}</text>',
        f'<text transform="translate(12 {middle}) rotate(-90)" text-anchor="middle">{escape(y.title)}</text>',
    ]


def _path(curve: Curve, *, across: _Scale, up: _Scale, height: int, color: str) -> str:
    points = zip(across.place(curve.x), up.place(curve.y), strict=True)
    steps = " ".join(f"{_x(float(px)):.1f},{_y(float(py), height):.1f}" for px, py in points)
    return f'<polyline points="{steps}" fill="none" stroke="{color}" stroke-width="1.3"/>'


def _legend(curves: Sequence[Curve]) -> str:
    named = [(curve.name, COLORS[i % len(COLORS)]) for i, curve in enumerate(curves) if curve.name]
    words = "".join(f'<tspan dx="10" fill="{color}">{escape(name)}</tspan>' for name, color in named)
    return f'<text x="{WIDTH - _RIGHT}" y="14" text-anchor="end">{words}</text>' if words else ""


MOST_CHARTS: Final = 8
"""Maximum number of drawn channels, to keep the page short."""
