"""Detection of a change in repeated measures, with a false-alarm rate that holds although the baseline is learnt.

Each measure of a repeat is compared with all earlier repeats of its event, by the t distribution that predicts one more
repeat of a Gaussian measure; its normal score is standard normal and independent from repeat to repeat, for any number
of learnt repeats (Quesenberry, 1991; Hawkins, 1987). The scores of all events feed a bank of exponentially weighted
moving averages, from one repeat to hundreds, so that a large change is found at once and a small one in time (Roberts,
1959; Lucas and Saccucci, 1990). The bank is a summary of the past: a likelihood ratio shows whether a step or a ramp
explains it better (Lai, 1995).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import scipy  # imports scipy.special on first use, which takes 0.2 s
from numpy.typing import ArrayLike, NDArray

WEIGHTS: Final = 0.5 ** np.arange(8.0)
"""Weight of the newest repeat in each average: 1 to 1/128."""
_KEPT: Final = 1.0 - WEIGHTS
_AGES: Final = np.unique(np.round(np.geomspace(1.0, 500.0, 40)))
"""Ages in repeats of a step or a ramp for which the past is searched."""
_SHORTEST_RAMP: Final = 3
"""Number of ages that only a step has: one, two and three repeats."""
_MEMORY: Final = WEIGHTS * _KEPT ** np.arange(_AGES[-1])[:, None]
"""Share of a score in each average, by the number of repeats since, shape (ages, scales)."""
_SMALLEST_DEVIATION: Final = 1e-9
"""Standard deviation below which repeats differ by rounding only, as a share of the baseline."""
_SMALLEST_TAIL: Final = 1e-290


def normal_score(t: NDArray[np.float64], freedom: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal value as improbable as a value of the t distribution."""
    tail = scipy.special.stdtr(freedom, -np.abs(t))
    # Where the tail underflows: Wallace (1959), accurate to a few percent there.
    far = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) * np.sqrt(freedom * np.log1p(t**2 / freedom))
    return np.sign(t) * np.where(tail > _SMALLEST_TAIL, -scipy.special.ndtri(np.maximum(tail, _SMALLEST_TAIL)), far)


@lru_cache(maxsize=8)
def _courses(old: int, learnt: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the contribution of a step and a ramp of each of `old` ages to the averages, shape (ages, scales).

    Learning during a change follows it and hides a part of it; `learnt`: Number of repeats in the present mean.
    """
    ages = _AGES[:old]
    place = ages[:, None] - np.arange(_AGES[-1])
    before = np.maximum(learnt - ages + 1.0, 1.0)[:, None]
    since = np.maximum(place - 1.0, 0.0)
    hidden = since / (before + since)
    return (place > 0.0) * (1.0 - hidden) @ _MEMORY, (place > 0.0) * place * (1.0 - 0.5 * hidden) @ _MEMORY


@dataclass(frozen=True)
class Explanation:
    """Kind of change.

    `sudden`: Whether it is a step rather than a ramp. `age`: Repeats since it began, the last one included. `evidence`:
    Logarithm of the likelihood ratio of the two, 0 or more.
    """

    sudden: bool
    age: int
    evidence: float


class ChangeDetector:
    """Change detector for measures of several events that share a specimen.

    Parameters
    ----------
    events : int
        Number of events, each with a separate baseline.
    measures : int
        Number of measures of a repeat, the same for all events.

    Attributes
    ----------
    count, mean, square : ndarray, shape (events, measures)
        Number of learnt repeats, their mean, and the sum of squares about it.
    averages : ndarray, shape (scales, measures)
        Moving averages of the normal scores.
    scored : int
        Number of repeats whose scores are in the averages.
    """

    def __init__(self, events: int, measures: int) -> None:
        self.count = np.zeros((events, measures))
        self.mean = np.zeros((events, measures))
        self.square = np.zeros((events, measures))
        self.averages = np.zeros((WEIGHTS.size, measures))
        self.scored = 0

    @property
    def tests(self) -> int:
        """Number of one-sided tests of a repeat."""
        return 2 * self.averages.size

    def learn(self, event: int, measures: ArrayLike, which: ArrayLike = True) -> None:
        """Learn from a repeat without a change.

        Parameters
        ----------
        event : int
            Number of the event.
        measures : array_like, shape (measures,)
            Measures of the repeat.
        which : array_like of bool, shape (measures,)
            Whether each measure is learnt.
        """
        count = self.count[event] + which
        step = np.where(which, measures - self.mean[event], 0.0)
        mean = self.mean[event] + step / np.maximum(count, 1.0)
        self.square[event] += step * np.where(which, measures - mean, 0.0)
        self.count[event], self.mean[event] = count, mean

    def score(self, event: int, measures: ArrayLike) -> NDArray[np.float64]:
        """Add a repeat to the averages and return their distances from 0 in standard deviations.

        Parameters
        ----------
        event : int
            Number of the event; at least two of its repeats are learnt.
        measures : array_like, shape (measures,)
            Measures of the repeat.

        Returns
        -------
        ndarray, shape (scales, measures)
            Distances, each standard normal as long as nothing changes.
        """
        count = self.count[event]
        freedom = count - 1.0
        deviation = np.maximum(np.sqrt(self.square[event] / freedom), _SMALLEST_DEVIATION)
        t = (measures - self.mean[event]) / (deviation * np.sqrt(1.0 + 1.0 / count))
        self.averages += WEIGHTS[:, None] * (normal_score(t, freedom) - self.averages)
        self.scored += 1
        return self.averages / np.sqrt(np.diag(self._covariance()))[:, None]

    def explain(self, measure: int) -> Explanation:
        """Find the best explanation of the averages of one measure: a step or a ramp, and its age.

        Parameters
        ----------
        measure : int
            Number of the measure.

        Returns
        -------
        Explanation
            Step or ramp. A change of fewer than four repeats is a step. One as old as the scores began while the
            baseline was learnt: a drift, of which the learnt scatter makes a constant score.
        """
        inverse = np.linalg.pinv(self._covariance(), rcond=1e-10, hermitian=True)
        old = np.searchsorted(_AGES, max(1, self.scored), side="right")
        ages = _AGES[:old]
        steps, ramps = _courses(int(old), float(self.count[:, measure].sum()))

        def best(shapes: NDArray[np.float64], ages: NDArray[np.float64]) -> tuple[float, int]:
            seen = shapes @ inverse
            gain = (seen @ self.averages[:, measure]) ** 2 / np.sum(seen * shapes, axis=1)
            return float(gain.max()), int(ages[np.argmax(gain)])

        step, step_age = best(steps, ages)
        if old <= _SHORTEST_RAMP:
            return Explanation(sudden=True, age=step_age, evidence=step)
        ramp, ramp_age = best(ramps[_SHORTEST_RAMP:], ages[_SHORTEST_RAMP:])
        if step >= ramp and step_age > _SHORTEST_RAMP and step_age == ages[-1]:
            return Explanation(sudden=False, age=step_age, evidence=0.5 * (step - ramp))
        sudden = step >= ramp
        return Explanation(sudden=sudden, age=step_age if sudden else ramp_age, evidence=0.5 * abs(step - ramp))

    def forget(self, event: int) -> None:
        """Restart the learning of an event.

        Parameters
        ----------
        event : int
            Number of the event. The averages restart for all events.
        """
        for learnt in (self.count, self.mean, self.square):
            learnt[event] = 0.0
        self.averages[:] = 0.0
        self.scored = 0

    def _covariance(self) -> NDArray[np.float64]:
        """Return the covariance of the averages while nothing changes, shape (scales, scales)."""
        kept = np.outer(_KEPT, _KEPT)
        return np.outer(WEIGHTS, WEIGHTS) * (1.0 - kept**self.scored) / (1.0 - kept)
