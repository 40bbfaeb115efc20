"""Limits of the statistics of a repeat: absolute ones, and those learnt from the first repeats of each event."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # imports scipy.special on first use, which takes 0.2 s
from numpy.typing import NDArray

from duralab_monitoring.alarms import Alarm, AlarmKind, AlarmLevel
from duralab_monitoring.repeat_statistics import COLUMNS
from duralab_monitoring.settings import MonitoringSettings


class StatisticLimits:
    """Limits of the statistics of every event.

    A learnt limit is passed by a statistic that differs from its baseline by the share of the level, and by more than
    the scatter of the baseline explains: the t distribution that predicts one more repeat. `probability`: Probability
    of one false alarm of one statistic in one direction. `mean`, `square`, shape (events, channels, columns): Mean of
    the baseline and sum of squares about it, damage as an amplitude. `latched`, the same shape: Highest raised level.
    """

    def __init__(
        self, settings: MonitoringSettings, *, events: int, channels: Sequence[str], probability: float
    ) -> None:
        self._channels, self._levels = tuple(channels), settings.learnt_limits
        self._exponent, self._repeats = float(settings.damage_exponent), settings.baseline_repeats
        self._quantile = -float(scipy.special.stdtrit(self._repeats - 1, probability))
        #: Lowest and highest value by level, shape (2, 2, channels, columns).
        self._bounds = np.empty((2, 2, len(channels), len(COLUMNS)))
        self._bounds[:, 0], self._bounds[:, 1] = -np.inf, np.inf
        for channel, limits in settings.limits.items():
            for statistic, given in limits.items():
                for level, interval in enumerate((given.warning, given.abort)):
                    if interval is not None:
                        self._bounds[level, :, self._channels.index(channel), COLUMNS.index(statistic)] = interval
        shape = (events, len(channels), len(COLUMNS))
        self.mean, self.square = np.zeros(shape), np.zeros(shape)
        self.latched = np.zeros(shape, dtype=np.int64)

    def learn(self, event: int, table: NDArray[np.float64], *, repeats: int) -> None:
        """Learn from a repeat of the baseline; `repeats`: Their number, this one included."""
        values = self._amplitudes(table)
        step = values - self.mean[event]
        self.mean[event] += step / repeats
        self.square[event] += step * (values - self.mean[event])

    def forget(self, event: int) -> None:
        """Restart the learning of an event."""
        self.mean[event] = self.square[event] = 0.0
        self.latched[event] = 0

    def judge(self, event: int, table: NDArray[np.float64], *, learnt: bool, repeat: int, name: str) -> list[Alarm]:
        """Raise each limit that a repeat passes, once for a level; `name`: Name of the event."""
        absolute = self._absolute(table)
        share, relative = np.zeros(table.shape), np.zeros(table.shape, dtype=np.int64)
        if learnt:
            share, beyond_noise = self._deviation(event, table)
            size = np.abs(share)
            relative = beyond_noise * (1 * (size >= self._levels.warning) + (size >= self._levels.abort))
        level = np.maximum(absolute, relative)
        alarms = []
        for channel, column in np.argwhere(level > self.latched[event]).tolist():
            raised = AlarmLevel(int(level[channel, column]))
            value, change = float(table[channel, column]), float(share[channel, column])
            by_value = absolute[channel, column] == raised
            said = f"is away from its baseline by {100.0 * change:+.3g} %"
            if by_value:
                said = self._outside(raised, channel, column)
            statistic = COLUMNS[column]
            alarms.append(
                Alarm(
                    level=raised,
                    kind=AlarmKind.LIMIT,
                    event=name,
                    channel=self._channels[channel],
                    measure=statistic,
                    band=None,
                    repeat=repeat,
                    since=repeat,
                    size=value if by_value else change,
                    sentence=f"{self._channels[channel]}: {statistic.value} of {value:.4g} {said}, in repeat {repeat} "
                    f"({name}).",
                )
            )
        self.latched[event] = np.maximum(self.latched[event], level)
        return alarms

    def passed_abort(self, table: NDArray[np.float64], present: NDArray[np.float64]) -> str:
        """Return the first absolute abort limit that a table passes farther than another, as a clause; empty if none.

        Both have the shape (channels, columns).
        """
        low, high = self._bounds[AlarmLevel.ABORT - 1]
        beyond, before = (np.maximum(np.maximum(low - each, each - high), 0.0) for each in (table, present))
        for channel, column in np.argwhere(beyond > before).tolist():
            what = f"{self._channels[channel]}: {COLUMNS[column].value} of {float(table[channel, column]):.4g}"
            return f"{what} {self._outside(AlarmLevel.ABORT, channel, column)}"
        return ""

    def _absolute(self, table: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the level of the absolute limits that each statistic passes; 0 for none."""
        below, above = table < self._bounds[:, 0], table > self._bounds[:, 1]
        return np.max((below | above) * np.array([1, 2])[:, None, None], axis=0)

    def _outside(self, level: AlarmLevel, channel: int, column: int) -> str:
        low, high = self._bounds[level - 1, :, channel, column]
        return f"is outside its {level.name.lower()} limits of {low:g} to {high:g}"

    def _amplitudes(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the statistics with damage as an equivalent amplitude, whose scatter is like that of the others."""
        values = table.copy()
        values[:, -1] **= 1.0 / self._exponent
        return values

    def _deviation(self, event: int, table: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the deviation from the baseline as a share of it, and where noise does not explain it."""
        baseline = self.mean[event]
        unit = baseline.copy()
        unit[:, :2] = 0.5 * (baseline[:, 1] - baseline[:, 0])[:, None]
        unit[:, 2:5] = baseline[:, 3, None]
        deviation = self._amplitudes(table) - baseline
        # A constant channel has no share: any deviation counts as 1.
        share = np.where(unit > 0.0, deviation / np.where(unit > 0.0, unit, 1.0), np.sign(deviation))
        scatter = np.sqrt(self.square[event] / (self._repeats - 1) * (1.0 + 1.0 / self._repeats))
        return share, np.abs(deviation) > self._quantile * scatter
