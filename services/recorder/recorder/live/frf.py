"""The identified FRF in the live view: magnitude, phase and coherence over frequency, for each response."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from recorder.live.charts import CANVAS, Axes, Drawing, Strip, draw_axes
from recorder.live.series import Colour, colour_of

_HEADER: Final = 50.0
_LEFT, _RIGHT = 74.0, 20.0
# Start and height of each panel as shares of a response's height.
_MAGNITUDE, _PHASE, _COHERENCE = (0.08, 0.40), (0.53, 0.17), (0.75, 0.12)
_COHERENCE_COLOUR: Final[Colour] = (225, 225, 225)
_STRONG, _WEAK = 2.0, 0.7


def draw_frf(
    frequency: np.ndarray,
    frf: np.ndarray,
    coherence: np.ndarray,
    *,
    responses: Sequence[str],
    drives: Sequence[str],
    drive_ranges: Sequence[float],
    band: tuple[float, float],
) -> Drawing:
    """Draw an FRF matrix and the coherence."""
    drawing = Drawing()
    shown = (frequency >= band[0]) & (frequency <= band[1]) & (frequency > 0)
    lines = frequency[shown]
    if len(lines) < 2:
        return drawing
    columns = max(1, math.ceil(math.sqrt(len(responses))))
    rows = math.ceil(len(responses) / columns)
    width, height = CANVAS[0] / columns, (CANVAS[1] - _HEADER) / rows
    for index, response in enumerate(responses):
        left, top = (index % columns) * width + _LEFT, (index // columns) * height + _HEADER
        strongest = _strongest(frf[shown, index], drive_ranges)

        def axes(
            place: tuple[float, float],
            values: tuple[float, float],
            *,
            decades: bool,
            left: float = left,
            top: float = top,
        ) -> Axes:
            return Axes(
                left,
                top + place[0] * height,
                width - _LEFT - _RIGHT,
                place[1] * height,
                (float(lines[0]), float(lines[-1])),
                values,
                decades,
            )

        low, high = _decades(np.abs(frf[shown, index]))
        _draw_magnitude(drawing, axes(_MAGNITUDE, (low, high), decades=True), lines, frf[shown, index], strongest)
        phases = axes(_PHASE, (-180.0, 180.0), decades=False)
        draw_axes(drawing, phases, value_ticks=(-180.0, -90.0, 0.0, 90.0, 180.0), frequency_labels=False)
        drawing.line(_phase(phases, lines, frf[shown, index, strongest]), colour=colour_of(strongest), width=1.4)
        coherences = axes(_COHERENCE, (0.0, 1.0), decades=False)
        draw_axes(drawing, coherences, value_ticks=(0.0, 0.5, 1.0), frequency_labels=True)
        drawing.line(coherences.place(lines, coherence[shown, index]), colour=_COHERENCE_COLOUR, width=1.4)
        _label_panels(drawing, response, (phases, coherences), left + (width - _LEFT - _RIGHT) / 2, top)
    for index, drive in enumerate(drives):
        drawing.label(CANVAS[0] * (index + 0.5) / len(drives), 18, f"from {drive}", colour=colour_of(index))
    return drawing


def _label_panels(drawing: Drawing, response: str, below: tuple[Axes, Axes], middle: float, top: float) -> None:
    phases, coherences = below
    drawing.label(middle, top + 14, f"|H| to {response}")
    drawing.label(middle, phases.top - 12, "phase [deg] from the strongest drive")
    drawing.label(middle, coherences.top - 12, "coherence")
    drawing.label(middle, coherences.top + coherences.height + 34, "frequency [Hz]")


def _strongest(frf: np.ndarray, drive_ranges: Sequence[float]) -> int:
    """Return the drive with the largest effect on a response over the band at full range; `frf` is (lines, drives)."""
    finite = np.where(np.isfinite(frf), np.abs(frf), 0.0)
    weight = np.array([scale if math.isfinite(scale) and scale > 0 else 1.0 for scale in drive_ranges])
    # The median, so that one resonance does not decide.
    return int(np.argmax(np.median(finite, axis=0) * weight))


def _decades(magnitude: np.ndarray) -> tuple[float, float]:
    usable = magnitude[np.isfinite(magnitude) & (magnitude > 0)]
    if usable.size == 0:
        return 0.0, 1.0
    low, high = math.floor(np.log10(usable.min())), math.ceil(np.log10(usable.max()))
    return float(low), float(max(high, low + 1))


def _draw_magnitude(drawing: Drawing, axes: Axes, frequency: np.ndarray, frf: np.ndarray, strongest: int) -> None:
    low, high = axes.values
    ticks = [10.0**decade for decade in range(int(low), int(high) + 1)]
    draw_axes(drawing, axes, value_ticks=ticks, frequency_labels=False)
    # The broad line last, over the others.
    for drive in sorted(range(frf.shape[1]), key=lambda index: index == strongest):
        width = _STRONG if drive == strongest else _WEAK
        drawing.line(axes.place(frequency, np.abs(frf[:, drive])), colour=colour_of(drive), width=width)


def _phase(axes: Axes, frequency: np.ndarray, frf: np.ndarray) -> Strip:
    """Return the phase in degrees as a strip, interrupted where it wraps from one end of the panel to the other."""
    phase = np.degrees(np.angle(np.where(np.isfinite(frf), frf, np.nan)))
    jumps = np.flatnonzero(np.abs(np.diff(phase)) > 180.0) + 1
    return axes.place(np.insert(frequency, jumps, np.nan), np.insert(phase, jumps, np.nan))
