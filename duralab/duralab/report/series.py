"""Sampled curves in a web page: as few points as the eye needs, as few bytes as they take."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from duralab_spectra import piece_extremes

POINTS_PER_PERIOD: Final = 10
"""Of the highest frequency in a curve: its peaks are drawn at 95 % or more."""

LARGEST_POINTS: Final = 16_000
"""Of one curve; longer ones are drawn as the envelope of least and greatest value."""


def encode(values: np.ndarray) -> dict[str, str]:
    """Return an array as plotly.js reads it: float32, base64 (a third of the size of decimal digits)."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


@dataclass(frozen=True, eq=False)
class EvenCurve:
    """A curve over an even grid.

    `start`, `step`: First abscissa and distance of the next. `values`, shape (points): The ordinates. `is_envelope`:
    True where least and greatest value of each stretch alternate.
    """

    start: float
    step: float
    values: np.ndarray
    is_envelope: bool

    def to_plotly(self) -> dict[str, Any]:
        """Return the curve's part of a plotly trace."""
        return {"x0": self.start, "dx": self.step, "y": encode(self.values)}


def thin_out(samples: np.ndarray, *, sample_rate: float, highest_frequency: float) -> EvenCurve:
    """Reduce a band-limited signal to what a plot shows of it."""
    stride = max(1, int(sample_rate / (POINTS_PER_PERIOD * highest_frequency)))
    if samples.size <= LARGEST_POINTS * stride:
        return EvenCurve(0.0, stride / sample_rate, samples[::stride], is_envelope=False)
    width = -(-samples.size // (LARGEST_POINTS // 2))
    envelope = samples[piece_extremes(samples, width)].ravel()
    return EvenCurve(width / 4 / sample_rate, width / 2 / sample_rate, envelope, is_envelope=True)
