"""Statistics of one repeat: a table of channels, and the residual against the baseline in each band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_loads import channel_damage
from duralab_monitoring.settings import Statistic

COLUMNS = tuple(Statistic)


@dataclass(frozen=True)
class RepeatStatistics:
    """Statistics of one repeat.

    Parameters
    ----------
    table : ndarray, shape (channels, 6)
        A column for each `Statistic`, in its order; the channel's unit, damage in that to the power of the exponent.
    measures : ndarray, shape (channels, 1 + 3 * bands)
        Response less baseline as shares of the RMS of the channel's baseline: static part, gain of each band, phase of
        each band, and the cube root of the remainder's energy in each band. NaN as long as the event has no mean
        response.
    lag : float
        Removed delay against the baseline, s; one for all channels. NaN as `measures`.
    """

    table: NDArray[np.float64]
    measures: NDArray[np.float64]
    lag: float

    @property
    def residual(self) -> NDArray[np.float64]:
        """RMS of response less baseline over that of the baseline: static part, then bands; (channels, 1 + bands)."""
        gain, phase, remainder = np.split(self.measures[:, 1:], 3, axis=1)
        return np.concatenate([np.abs(self.measures[:, :1]), np.sqrt(gain**2 + phase**2 + remainder**3)], axis=1)

    def column(self, statistic: Statistic) -> NDArray[np.float64]:
        """Return one statistic of all channels, shape (channels,)."""
        return self.table[:, COLUMNS.index(statistic)]


def statistics_table(response: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
    """Return the columns of `Statistic` for each channel of a record, shape (channels, 6)."""
    mean, std = response.mean(axis=1), response.std(axis=1)
    damage = channel_damage(response, exponents=(exponent,))[:, 0]
    return np.stack([response.min(axis=1), response.max(axis=1), mean, np.hypot(mean, std), std, damage], axis=1)
