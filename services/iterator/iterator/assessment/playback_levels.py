"""Partial playback levels: the first playbacks reproduce a share of the target, to protect the specimen.

A playback at level `l` plays `l` times a drive and divides the response by `l`: in these units the response of a linear
rig is the same at every level, so update, acceptance and errors do not depend on the level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from duralab_settings import StopCriteria
from iterator.assessment.metrics import IterationMetrics, best_iteration
from iterator.assessment.stop_criteria import Outcome, judge_end
from iterator.model import IterationHistory

_NOT_AT_A_PART: Final = {"relative_rms_error": 0.0, "damage_ratio": None, "smallest_improvement": 0.0}


def partial_playbacks(levels: Sequence[float]) -> int:
    """Return the number of playbacks before the first at full level.

    `levels`: Share of the target in each of the first playbacks, see `PlaybackSettings`.
    Returns: 0 or more.
    """
    return int(np.count_nonzero(np.asarray(levels) < 1.0))


def level_of(number: int, levels: Sequence[float]) -> float:
    """Return the level of a playback.

    `number`: From 1. `levels`: Levels of the first playbacks.
    Returns: Share of the target, above 0 to 1.
    """
    return float(levels[number - 1]) if number <= len(levels) else 1.0


def comparable_history(history: IterationHistory, levels: Sequence[float]) -> IterationHistory:
    """Return the playbacks that the next one is compared with: those at its level, or the last one if there are none.

    With friction that sticks at half level, errors at two levels are not comparable.

    `history`: All playbacks so far, each divided by its level. `levels`: Levels of the first playbacks.
    Returns: History with the target and at least one playback, unless there is none yet.
    """
    count = len(history.playbacks)
    level = level_of(count + 1, levels)
    same = sum(1 for number in range(1, count + 1) if level_of(number, levels) == level)
    kept = max(same, 1)
    if kept >= count:
        return history
    return IterationHistory(target=history.target, playbacks=history.playbacks[-kept:])


def best_at_full_level(
    metrics: tuple[IterationMetrics, ...], levels: Sequence[float], *, outcome: Outcome | None = None, since: int = 0
) -> int:
    """Return the number of the best playback of the whole target, which is judged, exported and confirmed.

    `metrics`: From the first playback to the last. `levels`: Levels of the first playbacks. `outcome`: Outcome of the
    iteration after the last playback; None before its end. If the target was reached, the last playback is the best:
    only it fulfils all criteria, regardless of the overall error of another. `since`: Number of playbacks before those
    whose figures are comparable with the last one's.
    Returns: Number from 1; 0 if no playback was at full level.
    """
    if outcome is Outcome.REACHED:
        return len(metrics)
    partial = max(partial_playbacks(levels), since)
    full = metrics[partial:]
    return partial + best_iteration(full) if full else 0


def judge_end_at_levels(
    metrics: tuple[IterationMetrics, ...], criteria: StopCriteria, levels: Sequence[float], *, since: int = 0
) -> Outcome | None:
    """Return the outcome if the iteration ends after the last playback, which may be at partial level.

    `metrics`: From the first playback to the last, one or more. `criteria`: Stop criteria. `levels`: Levels of the
    first playbacks. `since`: Number of playbacks before those whose figures are comparable with the last one's; they
    count for the damage budget only.
    Returns: None to continue.
    """
    partial = partial_playbacks(levels)
    if len(metrics) <= partial:
        # A part of the target's size does not reach the target, but may also diverge or cost too much damage.
        ended = judge_end(metrics[since:], criteria.model_copy(update=_NOT_AT_A_PART), earlier=metrics[:since])
        return ended if ended in (Outcome.DIVERGED, Outcome.DAMAGE_BUDGET_USED) else None
    begun = max(partial, since)
    left = criteria.model_copy(update={"iterations": criteria.iterations - begun})
    return judge_end(metrics[begun:], left, earlier=metrics[:begun])
