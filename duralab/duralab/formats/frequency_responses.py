"""A frequency response matrix with the channels it is between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from duralab.data import Channel


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """`frf` in y(f) = frf(f) u(f), with e^{+jωt}.

    Parameters
    ----------
    drives, responses : tuple of Channel
        Inputs and outputs.
    frequency : np.ndarray, shape (lines)
        In hertz, evenly spaced.
    frf : np.ndarray, shape (lines, responses, drives)
        Complex, response unit per drive unit.
    """

    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    frequency: np.ndarray
    frf: np.ndarray
