"""Conversion of a change detector's scores to alarms: significance, size, kind and place of a change."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import scipy  # imports scipy.special on first use, which takes 0.2 s
from numpy.typing import ArrayLike, NDArray

from duralab_monitoring.alarms import Alarm, AlarmKind, AlarmLevel
from duralab_monitoring.detection import ChangeDetector, Explanation
from duralab_monitoring.repeat_statistics import COLUMNS
from duralab_monitoring.residual import Measure
from duralab_monitoring.settings import MonitoringSettings

_ENOUGH_EVIDENCE: Final = 3.0
"""Logarithm of the likelihood ratio of step and ramp, 20 to 1, above which an alarm has its kind ..."""
_LONGEST_DOUBT: Final = 64
"""... and number of repeats after which it is raised with the likelier kind."""
_WORDS: Final = {AlarmKind.SUDDEN_CHANGE: "sudden change", AlarmKind.SLOW_DRIFT: "slow drift"}


class ChangeWatch:
    """Alarms of changes in the measures of the residual, for all events of an endurance test.

    Parameters
    ----------
    settings : MonitoringSettings
        Bands, levels and false-alarm rate.
    events, channels : sequence of str
        Names of the events and of the response channels.

    Attributes
    ----------
    detector : ChangeDetector
        Learnt values and averages.
    probability : float
        Probability of a false alarm in one test of one repeat: the stated rate divided among all tests, those of the
        learnt limits included.
    latched : ndarray of int, shape (channels,)
        Highest raised level.
    undecided : ndarray of int, shape (channels,)
        Number of repeats in which a change was certain and its kind was not.
    """

    def __init__(self, settings: MonitoringSettings, events: Sequence[str], *, channels: Sequence[str]) -> None:
        self._events, self._channels, self._levels = tuple(events), tuple(channels), settings.change
        self._bands = tuple(pairwise(settings.bands))
        #: Measures of a channel, in the order of `Reference.measures`.
        self._measures: list[tuple[Measure, tuple[float, float] | None]] = [(Measure.STATIC, None)]
        self._measures += [
            (measure, band) for measure in (Measure.GAIN, Measure.PHASE, Measure.REMAINDER) for band in self._bands
        ]
        self.detector = ChangeDetector(len(events), len(channels) * len(self._measures))
        tests = self.detector.tests + 2 * len(channels) * len(COLUMNS)
        self.probability = 1e-4 * settings.false_alarms / tests
        self._threshold = -float(scipy.special.ndtri(self.probability))
        self.latched = np.zeros(len(channels), dtype=np.int64)
        self.undecided = np.zeros(len(channels), dtype=np.int64)

    def learn(self, event: str, measures: ArrayLike) -> None:
        """Learn from a repeat of the baseline.

        Parameters
        ----------
        event : str
            Event that was played.
        measures : array_like, shape (channels, 1 + 3 * bands)
            Static part, then gain, phase and the cube root of the remainder's energy in each band; shares of the RMS.
        """
        self.detector.learn(self._events.index(event), np.ravel(measures))

    def forget(self, event: str) -> None:
        """Restart the learning of an event, and clear the alarms.

        Parameters
        ----------
        event : str
            Name of the event.
        """
        self.detector.forget(self._events.index(event))
        self.latched[:] = self.undecided[:] = 0

    def judge(self, repeat: int, event: str, measures: NDArray[np.float64]) -> list[Alarm]:
        """Search for a change in each measure; raise the clearest one of a channel, once for a level.

        Parameters
        ----------
        repeat : int
            Repeat of the schedule.
        event : str
            Event that was played; at least two of its repeats are learnt.
        measures : ndarray, shape (channels, 1 + 3 * bands)
            As for `learn`.

        Returns
        -------
        list of Alarm
            New alarms, at most one for each channel.
        """
        number, shape = self._events.index(event), measures.shape
        size = self._sizes(measures, self.detector.mean[number].reshape(shape))
        scores = np.abs(self.detector.score(number, measures.ravel())).max(axis=0).reshape(shape)
        # All other measures are learnt: scores that depend on earlier scores are no longer standard normal.
        learnt = (scores <= self._threshold) & (self.latched == 0)[:, None]
        self.detector.learn(number, measures.ravel(), learnt.ravel())
        magnitude = np.abs(size)
        level = 1 * (magnitude >= self._levels.warning) + (magnitude >= self._levels.abort)
        level *= scores > self._threshold
        raised = level.max(axis=1)
        self.undecided = np.where(raised > self.latched, self.undecided + 1, 0)
        alarms = []
        for channel in np.flatnonzero(self.undecided).tolist():
            clearest = int(np.argmax(np.where(level[channel] == raised[channel], scores[channel], -1.0)))
            explained = self.detector.explain(channel * shape[1] + clearest)
            certain = explained.evidence >= _ENOUGH_EVIDENCE or self.undecided[channel] > _LONGEST_DOUBT
            if not certain and raised[channel] < AlarmLevel.ABORT:
                continue
            self.latched[channel], self.undecided[channel] = raised[channel], 0
            found = AlarmLevel(int(raised[channel]))
            place = (event, channel, clearest)
            alarms.append(self._alarm(found, explained, place, repeat, float(size[channel, clearest])))
        return alarms

    def _sizes(self, measures: NDArray[np.float64], learnt: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change in each measure as a share of the channel's RMS."""
        remainder = 1 + 2 * len(self._bands)
        size = measures.copy()
        size[:, remainder:] = np.sqrt(np.maximum(measures[:, remainder:] ** 3 - learnt[:, remainder:] ** 3, 0.0))
        return size

    def _alarm(
        self, level: AlarmLevel, explained: Explanation, place: tuple[str, int, int], repeat: int, size: float
    ) -> Alarm:
        event, channel, (measure, band) = place[0], self._channels[place[1]], self._measures[place[2]]
        kind = AlarmKind.SUDDEN_CHANGE if explained.sudden else AlarmKind.SLOW_DRIFT
        since = max(0, repeat - explained.age + 1)
        where = "static part" if band is None else f"{band[0]:g} to {band[1]:g} Hz"
        return Alarm(
            level=level,
            kind=kind,
            event=event,
            channel=channel,
            measure=measure,
            band=band,
            repeat=repeat,
            since=since,
            size=size,
            sentence=f"{channel}, {where}: {_WORDS[kind]} of {100.0 * size:+.3g} % of the channel's RMS "
            f"({measure.value}), since about repeat {since}, found in repeat {repeat} ({event}).",
        )
