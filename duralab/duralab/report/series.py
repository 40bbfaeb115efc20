"""Compact sampled curves for a web page: only visible points, in a compact encoding."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from duralab_spectra import piece_extremes

POINTS_PER_PERIOD: Final = 10
"""Number of points per period of a curve's highest frequency; peaks are drawn at 95 % or more."""

LARGEST_POINTS: Final = 16_000
"""Maximum number of points of a curve; a longer one is drawn as the envelope of smallest and largest value."""


def encode(values: np.ndarray) -> dict[str, str]:
    """Return an array for plotly.js: float32, base64 (a third of the size of decimal digits)."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


@dataclass(frozen=True, eq=False)
class EvenCurve:
    """Curve over an even grid.

    `start`, `step`: First abscissa, and step. `values`, shape (points): Ordinates. `is_envelope`: Whether the smallest
    and largest value of each piece alternate.
    """

    start: float
    step: float
    values: np.ndarray
    is_envelope: bool

    def to_plotly(self) -> dict[str, Any]:
        """Return the curve's part of a plotly trace."""
        return {"x0": self.start, "dx": self.step, "y": encode(self.values)}


def thin_out(samples: np.ndarray, *, sample_rate: float, highest_frequency: float) -> EvenCurve:
    """Reduce a band-limited signal to the points that a plot needs."""
    stride = max(1, int(sample_rate / (POINTS_PER_PERIOD * highest_frequency)))
    if samples.size <= LARGEST_POINTS * stride:
        return EvenCurve(0.0, stride / sample_rate, samples[::stride], is_envelope=False)
    width = -(-samples.size // (LARGEST_POINTS // 2))
    envelope = samples[piece_extremes(samples, width)].ravel()
    return EvenCurve(width / 4 / sample_rate, width / 2 / sample_rate, envelope, is_envelope=True)
