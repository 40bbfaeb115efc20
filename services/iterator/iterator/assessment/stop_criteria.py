"""When the iteration ends, and why."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from iterator.assessment.metrics import IterationMetrics
from iterator.assessment.playback_bounds import PassedBound, PlaybackBounds
from loads import DAMAGE_EXPONENTS


class Outcome(enum.Enum):
    """Why an iteration ended."""

    REACHED = "every channel's error, and its damage ratio where bounds are asked, is as asked"
    ITERATIONS_USED = "all playbacks were used"
    DIVERGED = "a channel's error grew beyond the allowed multiple of its best"
    NO_IMPROVEMENT = "the last playbacks did not improve the best error by the asked share"
    DAMAGE_BUDGET_USED = "one more playback would put more damage into the specimen than was allowed"
    RESPONSE_STOOD_STILL = "a controlled response stood still while its target moved"
    BOUND_PASSED = "a playback passed a bound of error, peak or damage"


@dataclass(frozen=True)
class DamageBounds:
    """Between which a channel's damage ratio is as asked.

    Parameters
    ----------
    smallest, largest : float
        Bounds of response over target, `0 <= smallest < 1 < largest`.
    exponent : float
        Slope of the S-N line it is judged at, one of `DAMAGE_EXPONENTS`.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    smallest: float
    largest: float
    exponent: float = 5.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.smallest < 1.0 < self.largest < np.inf):
            raise ValueError(
                f"The damage ratio's bounds are {self.smallest:g} and {self.largest:g}; they must be finite, the "
                "smaller 0 or more and below 1, the larger above 1."
            )
        _column(self.exponent)

    def hold(self, metrics: IterationMetrics) -> bool:
        """Whether the damage ratio of every controlled channel is within them."""
        ratio = metrics.judged(metrics.damage_ratio)[:, _column(self.exponent)]
        return bool(np.all((ratio >= self.smallest) & (ratio <= self.largest)))


@dataclass(frozen=True)
class StopCriteria:
    """When to end.

    Parameters
    ----------
    largest_iterations : int
        Playbacks of the target, 1 or more.
    relative_rms_error : float
        Reached when every channel's is at most this; 0 does not ask for it.
    divergence_ratio : float
        Diverged when a channel's error exceeds this multiple of its best so far, above 1; 0 never.
    damage : DamageBounds, optional
        Reached only when every channel's damage ratio is within them, in the same playback as the error asked for.
        Where neither is given, all playbacks are used.
    smallest_improvement : float
        No more improvement when the best overall error of the last `improvement_playbacks` is not this share below
        the best before them, 0 to below 1; 0 never.
    improvement_playbacks : int
        See there, 1 or more.
    damage_budget : float
        Damage that all playbacks together may put into the specimen at any response, in multiples of the target's,
        greater than 0; 0 is no limit. A playback counts as the target at its level at least, whatever was measured.
        What the identification puts in is not counted: it is not known here.
    damage_budget_exponent : float
        Slope of the S-N line it is counted at, one of `DAMAGE_EXPONENTS`; that of the bounds, too.
    bounds : PlaybackBounds
        What no playback may pass, measured or predicted; `NO_BOUNDS` for none.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    largest_iterations: int
    relative_rms_error: float = 0.0
    divergence_ratio: float = 0.0
    damage: DamageBounds | None = None
    smallest_improvement: float = 0.0
    improvement_playbacks: int = 2
    damage_budget: float = 0.0
    damage_budget_exponent: float = 5.0
    bounds: PlaybackBounds = field(default_factory=PlaybackBounds)

    def __post_init__(self) -> None:
        if self.largest_iterations < 1:
            raise ValueError(f"The largest number of playbacks is {self.largest_iterations}; it must be 1 or more.")
        if not (0.0 <= self.relative_rms_error < np.inf):
            raise ValueError(
                f"The relative RMS error to reach is {self.relative_rms_error:g}; it must be finite and 0 or more."
            )
        if self.divergence_ratio != 0.0 and not (1.0 < self.divergence_ratio < np.inf):
            raise ValueError(
                f"The divergence ratio is {self.divergence_ratio:g}; it must be above 1, or 0 to never end so."
            )
        if not 0.0 <= self.smallest_improvement < 1.0:
            raise ValueError(
                f"The smallest improvement is {self.smallest_improvement:g}; it must be below 1, and above 0 or 0 to "
                "never end so."
            )
        if self.improvement_playbacks < 1:
            raise ValueError(
                f"Improvement is looked for over {self.improvement_playbacks} playbacks; it must be 1 or more."
            )
        if not (0.0 <= self.damage_budget < np.inf):
            raise ValueError(
                f"The damage budget is {self.damage_budget:g} of the target's; it must be finite, and above 0 or 0 for "
                "no limit."
            )
        _column(self.damage_budget_exponent)


def passed_bound(metrics: IterationMetrics, criteria: StopCriteria, *, level: float) -> PassedBound | None:
    """Return the bound that a playback passes furthest, or None.

    Parameters
    ----------
    metrics : IterationMetrics
        Of the playback, measured or predicted.
    criteria : StopCriteria
        Its bounds and exponent count.
    level : float
        Share of the target that it plays for, above 0 to 1.

    Returns
    -------
    PassedBound or None
        None if the playback passes no bound.
    """
    return criteria.bounds.passed(metrics, level=level, exponent=criteria.damage_budget_exponent)


def judge_end(
    metrics: tuple[IterationMetrics, ...],
    criteria: StopCriteria,
    *,
    earlier: tuple[IterationMetrics, ...] = (),
) -> Outcome | None:
    """Say whether the iteration ends after the last playback; watched responses have no say in it.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        From the first playback to the last, one or more.
    criteria : StopCriteria
        Reaching what is asked counts before diverging, then the damage budget, no more improvement, and all playbacks
        being used.
    earlier : tuple of IterationMetrics
        Playbacks before the first that counts, at partial level say: they count for the damage budget only.

    Returns
    -------
    Outcome or None
        None: go on.
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
    if len(metrics) >= criteria.largest_iterations:
        return Outcome.ITERATIONS_USED
    return None


def damage_spent(metrics: tuple[IterationMetrics, ...], *, exponent: float) -> NDArray[np.float64]:
    """Return the damage that playbacks have put into the specimen.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        Of all playbacks, one or more.
    exponent : float
        Slope of the S-N line, one of `DAMAGE_EXPONENTS`.

    Returns
    -------
    ndarray, shape (n_y,)
        At each response, in multiples of the whole target's; each playback counts as the target at its level at least.

    Raises
    ------
    ValueError
        Another exponent.
    """
    return np.sum([figures.specimen_damage[:, _column(exponent)] for figures in metrics], axis=0)


def would_overspend(metrics: tuple[IterationMetrics, ...], criteria: StopCriteria) -> bool:
    """Return whether the next playback may pass the budget: it does the target's damage, or the last one's if more.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        Of all playbacks, one or more.
    criteria : StopCriteria
        Its damage budget and exponent count.

    Returns
    -------
    bool
        At any controlled response.
    """
    exponent = criteria.damage_budget_exponent
    last = metrics[-1]
    next_one = np.maximum(1.0, last.specimen_damage[:, _column(exponent)])
    spent = damage_spent(metrics, exponent=exponent) + next_one
    return bool(np.any(last.judged(spent) > criteria.damage_budget))


def _reached(last: IterationMetrics, criteria: StopCriteria) -> bool:
    if criteria.relative_rms_error == 0.0 and criteria.damage is None:
        return False
    if criteria.relative_rms_error > 0.0 and np.any(last.judged(last.relative_rms_error) > criteria.relative_rms_error):
        return False
    return criteria.damage is None or criteria.damage.hold(last)


def _improves(metrics: tuple[IterationMetrics, ...], criteria: StopCriteria) -> bool:
    recent = criteria.improvement_playbacks
    if len(metrics) <= recent:
        return True
    overall = [figures.overall_relative_rms_error for figures in metrics]
    return min(overall[-recent:]) < (1.0 - criteria.smallest_improvement) * min(overall[:-recent])


def _column(exponent: float) -> int:
    """Column of a damage figure that holds an exponent."""
    if exponent not in DAMAGE_EXPONENTS:
        offered = ", ".join(f"{value:g}" for value in DAMAGE_EXPONENTS)
        raise ValueError(f"The exponent of the S-N line is {exponent:g}; damage is judged at {offered}.")
    return DAMAGE_EXPONENTS.index(exponent)
