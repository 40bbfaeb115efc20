"""Iteration gains: per response channel, per frequency, and scheduled over the playbacks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duralab_settings import ResolvedUpdate


def gain_at(frequency: NDArray[np.float64], settings: ResolvedUpdate, *, playbacks: int) -> NDArray[np.float64]:
    """Return the diagonal of `Q` of the next update at each line."""
    iteration_gain, schedule = np.array(settings.iteration_gain), settings.gain_schedule or (1.0,)
    gain = np.broadcast_to(iteration_gain, (frequency.size, iteration_gain.size))
    gain = gain * schedule[min(playbacks, len(schedule) - 1)]
    if settings.gain_curve_frequency is None or settings.gain_curve_share is None:
        return gain
    share = np.array(settings.gain_curve_share)
    points = np.array(settings.gain_curve_frequency)
    return gain * np.stack([np.interp(frequency, points, of_channel) for of_channel in share.T], axis=1)
