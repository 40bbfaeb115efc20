"""Trends of an endurance test: statistics of every repeat, thinned, with their limits."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from duralab.lab import EnduranceAlarm, PlayedRepeat
from duralab_monitoring import Levels, MonitoringSettings, Statistic
from operator_page.envelope import Envelope

BUCKETS: Final = 400
MOST_ALARMS: Final = 500
RESIDUAL: Final = "residual"
STATISTICS: Final = (*(each.value for each in Statistic), RESIDUAL)
"""Available curves: statistics of a repeat, and its residual against the baseline, all bands together."""

_DAMAGE: Final = list(Statistic).index(Statistic.DAMAGE)
_RMS: Final = list(Statistic).index(Statistic.RMS)


@dataclass
class _Baseline:
    """Mean of the first repeats of an event, damage as an amplitude; shape (responses, statistics)."""

    key: tuple[int, int]
    first: int
    repeats: int = 0
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def learn(self, values: np.ndarray) -> None:
        self.repeats += 1
        self.mean = values if self.repeats == 1 else self.mean + (values - self.mean) / self.repeats

    def limits(self, column: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lowest and highest value of a statistic at a share of the baseline, as the monitor judges it."""
        mean = self.mean[:, column]
        if column < 2:
            unit = 0.5 * (self.mean[:, 1] - self.mean[:, 0])
        else:
            unit = mean if column == _DAMAGE else self.mean[:, _RMS]
        return mean - share * unit, mean + share * unit


class Trends:
    """Repeats of one endurance test, thinned: memory is constant over millions of them.

    `settings`: Settings of the schedule. `responses`: Names of the channels. `columns`: Columns of the statistics.
    """

    def __init__(
        self, settings: MonitoringSettings, events: list[str], *, responses: list[str], columns: tuple[str, ...]
    ) -> None:
        self._settings, self.responses = settings, responses
        self._residual = [place for place, name in enumerate(columns) if name.startswith(RESIDUAL)]
        size = len(responses) * len(STATISTICS)
        self._curves = {event: Envelope(size, buckets=BUCKETS) for event in events}
        self._baselines: dict[str, list[_Baseline]] = {event: [] for event in events}
        self.alarms: deque[EnduranceAlarm] = deque(maxlen=MOST_ALARMS)
        self.unknown: deque[tuple[int, str]] = deque(maxlen=MOST_ALARMS)

    def put(self, repeat: PlayedRepeat) -> None:
        """Add the next repeat."""
        self.alarms.extend(repeat.alarms)
        if repeat.statistics is None:
            self.unknown.append((repeat.repeat, repeat.reason))
            return
        table = repeat.statistics[:, : len(Statistic)]
        residual = np.sqrt(np.sum(repeat.statistics[:, self._residual] ** 2, axis=1, keepdims=True))
        self._curves[repeat.event].put(repeat.repeat, np.concatenate([table, residual], axis=1).reshape(-1, 1))
        baselines = self._baselines[repeat.event]
        if not baselines or baselines[-1].key != repeat.baseline:
            baselines.append(_Baseline(repeat.baseline, repeat.repeat))
        if baselines[-1].repeats < self._settings.baseline_repeats:
            amplitudes = table.copy()
            amplitudes[:, _DAMAGE] **= 1.0 / float(self._settings.damage_exponent)
            baselines[-1].learn(amplitudes)

    def curves(self, event: str, statistic: str) -> dict[str, Any]:
        """Return one statistic of an event, all responses: smallest and largest value of each bucket, and limits."""
        column, envelope = STATISTICS.index(statistic), self._curves[event]
        low, high = (values[column :: len(STATISTICS)] for values in envelope.part(0))
        learnt = [each for each in self._baselines[event] if each.repeats >= self._settings.baseline_repeats]
        learning = next((each.repeats for each in self._baselines[event][-1:] if each not in learnt), None)
        return {
            "event": event,
            "statistic": statistic,
            "bucket": envelope.bucket_samples,
            "low": low,
            "high": high,
            "learning": learning,
            "baseline_repeats": self._settings.baseline_repeats,
            "limits": [
                {"name": name, "first": first, "low": lowest, "high": highest}
                for name, first, lowest, highest in self._limits(statistic, column, learnt)
            ],
        }

    def _limits(
        self, statistic: str, column: int, learnt: list[_Baseline]
    ) -> list[tuple[str, int, np.ndarray, np.ndarray]]:
        """Return limits: warning or abort, the first repeat of their use, lowest and highest by response."""
        absent = np.full(len(self.responses), np.nan)
        found = []
        levels: Levels = self._settings.change if statistic == RESIDUAL else self._settings.learnt_limits
        for name, share in (("warning", levels.warning), ("abort", levels.abort)):
            if statistic == RESIDUAL:
                if share > 0.0:
                    found.append((name, 0, absent, np.full(absent.shape, share)))
                continue
            for baseline in learnt:
                lowest, highest = baseline.limits(column, share)
                if column == _DAMAGE:
                    exponent = float(self._settings.damage_exponent)
                    lowest, highest = np.maximum(lowest, 0.0) ** exponent, highest**exponent
                found.append((name, baseline.first, lowest, highest))
            given = [self._settings.limits.get(channel, {}).get(Statistic(statistic)) for channel in self.responses]
            pairs = [getattr(each, name) or (np.nan, np.nan) if each else (np.nan, np.nan) for each in given]
            if np.isfinite(pairs).any():
                found.append((f"absolute {name}", 0, *np.array(pairs, dtype=float).T))
        return found
