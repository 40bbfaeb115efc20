"""When the iteration ends, and why."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from iterator.iteration_metrics import IterationMetrics


class Outcome(enum.Enum):
    """Why an iteration ended."""

    REACHED = "every channel's error is at or below the asked one"
    ITERATIONS_USED = "all playbacks were used"
    DIVERGED = "a channel's error grew beyond the allowed multiple of its best"


@dataclass(frozen=True)
class StopCriteria:
    """When to end.

    Parameters
    ----------
    largest_iterations : int
        Playbacks of the target, 1 or more.
    relative_rms_error : float
        Reached when every channel's is at most this; 0 uses all playbacks.
    divergence_ratio : float
        Diverged when a channel's error exceeds this multiple of its best so far, above 1; 0 never.
    """

    largest_iterations: int
    relative_rms_error: float = 0.0
    divergence_ratio: float = 0.0

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


def judge_end(metrics: tuple[IterationMetrics, ...], criteria: StopCriteria) -> Outcome | None:
    """Say whether the iteration ends after the last playback.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        From the first playback to the last, one or more.
    criteria : StopCriteria
        Reaching the asked error counts before diverging, and diverging before having used all playbacks.

    Returns
    -------
    Outcome or None
        None: go on.
    """
    errors = np.array([figures.relative_rms_error for figures in metrics])
    last = errors[-1]
    if criteria.relative_rms_error > 0.0 and np.all(last <= criteria.relative_rms_error):
        return Outcome.REACHED
    if criteria.divergence_ratio > 0.0 and np.any(last > criteria.divergence_ratio * errors.min(axis=0)):
        return Outcome.DIVERGED
    if len(metrics) >= criteria.largest_iterations:
        return Outcome.ITERATIONS_USED
    return None
