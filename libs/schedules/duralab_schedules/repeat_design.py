"""Repeats of events so that the damage of all channels meets a plan: bounded least squares, then whole numbers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_schedules.schedule import MOST_REPEATS, ScheduleError

# Least gain of a step as a share of the misfit: below it, two numbers differ by rounding only.
_LEAST_GAIN: Final = 1e-12


@dataclass(frozen=True)
class Design:
    """Designed repeats, and the difference of their damage from the plan.

    Parameters
    ----------
    repeats : ndarray, shape (events,)
        Whole numbers within their bounds.
    damage : ndarray, shape (channels,)
        Damage of all repeats, in the unit of the damage plan.
    residual : ndarray, shape (channels,)
        Damage over the damage plan, less 1: 0 is met, negative is less than the plan.
    fractional : ndarray, shape (events,)
        Least-squares solution before rounding.
    """

    repeats: NDArray[np.int64]
    damage: NDArray[np.float64]
    residual: NDArray[np.float64]
    fractional: NDArray[np.float64]

    @property
    def misfit(self) -> float:
        """Root mean square of the residual over the channels."""
        return float(np.sqrt(np.mean(self.residual**2)))


def design(
    damage: ArrayLike, planned: ArrayLike, *, at_least: ArrayLike | None = None, at_most: ArrayLike | None = None
) -> Design:
    """Choose the repeats of events so that the damage of all channels meets a plan.

    Parameters
    ----------
    damage : array_like, shape (events, channels)
        Damage of one repeat of each event, 0 or more; in each channel of the same unit as the damage plan.
    planned : array_like, shape (channels,)
        Damage to reach, above 0.
    at_least, at_most : array_like of int, shape (events,), optional
        Bounds of the repeats; from 0 to `MOST_REPEATS` if omitted.

    Returns
    -------
    Design
        Repeats with the residual of each channel.

    Raises
    ------
    ScheduleError
        If a value is not allowed, or no event damages a channel.

    Notes
    -----
    The sum over the channels of (damage / planned − 1)² is smallest among all real numbers within the bounds (bounded
    non-negative least squares: Lawson and Hanson, "Solving Least Squares Problems", 1974; bounds: Stark and Parker,
    1995). The numbers are rounded, then improved by steps of 1 of one event or of two at once until no step gains.
    """
    each, plan = np.asarray(damage, dtype=np.float64), np.asarray(planned, dtype=np.float64)
    if each.ndim != 2 or plan.shape != each.shape[1:] or each.size == 0:
        raise ScheduleError(
            f"The damage has the shape {each.shape} and the plan {plan.shape}; give (events, channels) and (channels,)."
        )
    if not (np.all(np.isfinite(each)) and np.all(each >= 0.0)):
        raise ScheduleError("The damage of an event is negative or not finite; give numbers of 0 or more.")
    if not (np.all(np.isfinite(plan)) and np.all(plan > 0.0)):
        raise ScheduleError("The damage plan of a channel is not above 0; leave that channel out.")
    if (idle := np.flatnonzero(~each.any(axis=0))).size:
        raise ScheduleError(f"No event damages channel {idle[0]}; leave it out of the plan, or add an event that does.")
    low = np.zeros(len(each), dtype=np.int64) if at_least is None else np.asarray(at_least, dtype=np.int64)
    high = np.full(len(each), MOST_REPEATS) if at_most is None else np.asarray(at_most, dtype=np.int64)
    if low.shape != (len(each),) or high.shape != low.shape or np.any(low < 0) or np.any(low > high):
        raise ScheduleError("The bounds of the repeats do not fit; give 0 ≤ at_least ≤ at_most for each event.")
    shares = (each / plan).T
    fractional = _bounded_least_squares(shares, low, high)
    repeats = _whole(shares, fractional, low, high)
    reached = shares @ repeats
    return Design(repeats=repeats, damage=reached * plan, residual=reached - 1.0, fractional=fractional)


def _bounded_least_squares(
    shares: NDArray[np.float64], low: NDArray[np.int64], high: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return x in its bounds with the smallest sum of (shares x − 1)²; shares of shape (channels, events)."""
    found = low.astype(np.float64)
    # The solver does not accept equal bounds; an event without damage stays at its lower bound.
    free = np.flatnonzero((low < high) & shares.any(axis=0))
    if free.size:
        # Columns of norm 1: repeats of events differ by decades.
        norms = np.linalg.norm(shares[:, free], axis=0)
        # The import takes half a second, and a service that designs no schedule must start at once.
        from scipy.optimize import lsq_linear

        solved = lsq_linear(
            shares[:, free] / norms,
            1.0 - shares @ low,
            bounds=(0.0, (high - low)[free] * norms),
            method="bvls",
            max_iter=100 + 10 * free.size,
        )
        if not solved.success:
            raise ScheduleError(f"The repeats cannot be designed ({solved.message}); give narrower bounds.")
        found[free] += solved.x / norms
    return np.clip(found, low, high)


def _whole(
    shares: NDArray[np.float64], fractional: NDArray[np.float64], low: NDArray[np.int64], high: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Round, then choose the step of 1 of one or two events that gains most, until no step gains."""
    unit = np.eye(len(fractional), dtype=np.int64)
    steps = np.array(
        [*unit, *-unit]
        + [
            first * unit[i] + second * unit[j]
            for i, j in combinations(range(len(unit)), 2)
            for first in (1, -1)
            for second in (1, -1)
        ]
    )
    changes = steps @ shares.T
    repeats = np.clip(np.rint(fractional), low, high).astype(np.int64)
    while True:
        error = shares @ repeats - 1.0
        gains = -np.sum(changes * (2.0 * error + changes), axis=1)
        gains[np.any((repeats + steps < low) | (repeats + steps > high), axis=1)] = -np.inf
        best = int(np.argmax(gains))
        if gains[best] <= _LEAST_GAIN * np.sum(error**2):
            return repeats
        repeats = repeats + steps[best]
