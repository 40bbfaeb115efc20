"""Stop criteria of the iteration."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

from duralab_loads import DAMAGE_EXPONENTS
from duralab_settings import StopCriteria
from iterator.assessment.metrics import IterationMetrics


class Outcome(enum.Enum):
    """Reason for the end of an iteration."""

    REACHED = "every channel's error, and its damage ratio where bounds are asked, is as asked"
    ITERATIONS_USED = "all playbacks were used"
    DIVERGED = "a channel's error grew beyond the allowed multiple of its best"
    NO_IMPROVEMENT = "the last playbacks did not improve the best error by the asked share"
    DAMAGE_BUDGET_USED = "identification and playbacks left no room in the damage budget for one more playback"
    RESPONSE_STOOD_STILL = "a controlled response stood still while its target moved"
    BOUND_PASSED = "a playback passed a bound of error, peak or damage"
    ENDED_AT_HOLD_POINT = "a person ended it at a hold point"


def judge_end(
    metrics: tuple[IterationMetrics, ...],
    criteria: StopCriteria,
    *,
    earlier: tuple[IterationMetrics, ...] = (),
) -> Outcome | None:
    """Return the outcome if the iteration ends after the last playback; monitored responses are not considered.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        Figures from the first playback to the last, one or more.
    criteria : StopCriteria
        Stop criteria, applied in this order: target reached, divergence, damage budget, no improvement, number of
        playbacks.
    earlier : tuple of IterationMetrics
        Playbacks before the first counted one, e.g. at partial level: they count for the damage budget only.

    Returns
    -------
    Outcome or None
        Outcome, or None to continue.
    """
    errors = np.array([figures.judged(figures.relative_rms_error) for figures in metrics])
    if _reached(metrics[-1], criteria):
        return Outcome.REACHED
    if criteria.divergence_ratio > 0.0 and np.any(errors[-1] > criteria.divergence_ratio * errors.min(axis=0)):
        return Outcome.DIVERGED
    if criteria.damage_budget > 0.0 and would_overspend((*earlier, *metrics), criteria):
        return Outcome.DAMAGE_BUDGET_USED
    if criteria.smallest_improvement > 0.0 and not _improves(metrics, criteria):
        return Outcome.NO_IMPROVEMENT
    if len(metrics) >= criteria.iterations:
        return Outcome.ITERATIONS_USED
    return None


def damage_spent(metrics: tuple[IterationMetrics, ...], *, exponent: float) -> NDArray[np.float64]:
    """Return the damage that the identification and the playbacks have spent on the specimen.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        Figures of all playbacks, one or more.
    exponent : float
        Slope of the S-N line, one of `DAMAGE_EXPONENTS`.

    Returns
    -------
    ndarray, shape (n_y,)
        Damage at each response, in passes of the target; each playback counts at least as the target at its level.
        An identification of unknown damage does not count.

    Raises
    ------
    ValueError
        The exponent is not in `DAMAGE_EXPONENTS`.
    """
    spent = np.sum([figures.specimen_damage[:, _column(exponent)] for figures in metrics], axis=0)
    before = metrics[-1].identification_damage
    return spent if before is None else spent + before[:, _column(exponent)]


def would_overspend(metrics: tuple[IterationMetrics, ...], criteria: StopCriteria) -> bool:
    """Return whether the next playback may exceed the budget: it is expected to do at least the target's damage.

    `metrics`: Figures of all playbacks, one or more; the last playback's damage is expected if it is larger.
    `criteria`: Damage budget and exponent.
    Returns: True if a controlled response would exceed the budget.
    """
    exponent = criteria.damage_exponent
    last = metrics[-1]
    next_one = np.maximum(1.0, last.specimen_damage[:, _column(exponent)])
    spent = damage_spent(metrics, exponent=exponent) + next_one
    return bool(np.any(last.judged(spent) > criteria.damage_budget))


def _reached(last: IterationMetrics, criteria: StopCriteria) -> bool:
    if criteria.relative_rms_error == 0.0 and criteria.damage_ratio is None:
        return False
    if criteria.relative_rms_error > 0.0 and np.any(last.judged(last.relative_rms_error) > criteria.relative_rms_error):
        return False
    if criteria.damage_ratio is None:
        return True
    smallest, largest = criteria.damage_ratio
    ratio = last.judged(last.damage_ratio)[:, _column(criteria.damage_exponent)]
    return bool(np.all((ratio >= smallest) & (ratio <= largest)))


def _improves(metrics: tuple[IterationMetrics, ...], criteria: StopCriteria) -> bool:
    recent = criteria.improvement_playbacks
    if len(metrics) <= recent:
        return True
    overall = [figures.overall_relative_rms_error for figures in metrics]
    return min(overall[-recent:]) < (1.0 - criteria.smallest_improvement) * min(overall[:-recent])


def _column(exponent: float) -> int:
    """Return the column of a damage figure that holds an exponent."""
    if exponent not in DAMAGE_EXPONENTS:
        offered = ", ".join(f"{value:g}" for value in DAMAGE_EXPONENTS)
        raise ValueError(f"The exponent of the S-N line is {exponent:g}; damage is judged at {offered}.")
    return DAMAGE_EXPONENTS.index(exponent)
