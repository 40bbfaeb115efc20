"""Bounds of one playback, predicted and measured: largest excess over the target before the campaign ends."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from duralab_loads import DAMAGE_EXPONENTS
from duralab_settings import StopCriteria
from iterator.assessment.metrics import IterationMetrics


class BoundedQuantity(enum.Enum):
    """Bounded quantity of a playback; the value is the name of its bound in settings and messages."""

    ERROR = "error_bound"
    PEAK = "peak_bound"
    DAMAGE = "damage_bound"


_WORDS: Final = {
    BoundedQuantity.ERROR: "relative RMS error",
    BoundedQuantity.PEAK: "peak over the target's",
    BoundedQuantity.DAMAGE: "damage over the target's",
}


@dataclass(frozen=True)
class PassedBound:
    """A bound that a response exceeds.

    Parameters
    ----------
    response : int
        Row of the response.
    quantity : BoundedQuantity
        Bounded quantity of the playback.
    value, bound : float
        Value and its bound, relative to the whole target.
    """

    response: int
    quantity: BoundedQuantity
    value: float
    bound: float

    def sentence(self, name: str) -> str:
        """Return the value and the bound as text, without a full stop."""
        return (
            f"the {_WORDS[self.quantity]} of {name} is {self.value:.3g}, past stop.{self.quantity.value} of "
            f"{self.bound:g}"
        )


class PlaybackBoundError(ValueError):
    """Refusal of a drive, because the response that the model predicts for it exceeds a bound.

    Parameters
    ----------
    number : int
        Number of the playback, from 1.
    passed : PassedBound
        Exceeded bound with the largest ratio of value to bound.
    """

    def __init__(self, number: int, passed: PassedBound) -> None:
        self.number = number
        self.passed = passed
        super().__init__(self.sentence(f"response {passed.response}"))

    def sentence(self, name: str) -> str:
        """Return the error as text with the name of its response."""
        return (
            f"Playback {self.number} is not played: by the model's prediction {self.passed.sentence(name)}; look at "
            "the target and the model there, begin at partial levels, or take a smaller gain."
        )


def is_bounded(criteria: StopCriteria) -> bool:
    """Return whether any quantity of a playback is bounded.

    `criteria`: Criteria with the bounds.
    Returns: False if every bound is None.
    """
    return any(getattr(criteria, quantity.value) is not None for quantity in BoundedQuantity)


def passed_bound(metrics: IterationMetrics, criteria: StopCriteria, *, level: float) -> PassedBound | None:
    """Return the bound that a playback exceeds by the largest ratio, or None.

    `metrics`: Figures of the playback, measured or predicted. `criteria`: Criteria whose bounds and damage exponent are
    used, relative to the whole target at every level. `level`: Share of the target that is played, above 0 to 1.
    Returns: None if the playback exceeds no bound.
    """
    exponent = float(criteria.damage_exponent)
    column = DAMAGE_EXPONENTS.index(exponent)
    figures = {
        BoundedQuantity.ERROR: level * metrics.relative_rms_error,
        BoundedQuantity.PEAK: level * metrics.peak_ratio,
        BoundedQuantity.DAMAGE: level**exponent * metrics.damage_ratio[:, column],
    }
    controlled = np.ones(len(metrics.peak_ratio), dtype=bool) if metrics.controlled is None else metrics.controlled
    worst: PassedBound | None = None
    for quantity, values in figures.items():
        bound = getattr(criteria, quantity.value)
        if bound is None:
            continue
        row = int(np.argmax(np.where(controlled, values, -np.inf)))
        found = PassedBound(response=row, quantity=quantity, value=float(values[row]), bound=bound)
        if found.value > bound and (worst is None or found.value / bound > worst.value / worst.bound):
            worst = found
    return worst


NO_BOUNDS: Final[Mapping[str, None]] = MappingProxyType(dict.fromkeys(quantity.value for quantity in BoundedQuantity))
"""Keyword arguments of `StopCriteria` for studies of divergence, on rigs without a risk of damage."""
