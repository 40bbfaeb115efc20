"""Which repeats are recorded with all samples: the first, every n-th, and those around an alarm."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_schedules import KeepRule


@dataclass(frozen=True)
class HeldRepeat:
    """A repeat whose signal blocks are not kept, with its response, shape (responses, samples)."""

    repeat: int
    event: int
    drive: int
    run: str
    response: NDArray[np.float64]


class KeptSamples:
    """The rule of a schedule, and the last responses in case an alarm asks for them.

    `rule`: Of the schedule. `kept_before`: Repeats before this one are kept because of an alarm.
    """

    def __init__(self, rule: KeepRule, *, kept_before: int = 0) -> None:
        self._rule = rule
        self.kept_before = kept_before
        self._held: deque[HeldRepeat] = deque(maxlen=rule.around_alarm + 1)

    def keeps(self, repeat: int, nth: int) -> bool:
        """Return whether the signal blocks of a repeat are kept; it is the `nth` of its event, from 0."""
        return repeat < self.kept_before or self._rule.keeps(nth)

    def hold(self, held: HeldRepeat) -> None:
        """Hold a repeat that was played until as many others follow as an alarm asks for."""
        self._held.append(held)

    def after_alarm(self, repeat: int) -> list[HeldRepeat]:
        """Return the held repeats around an alarm, and keep as many after it; each is returned once."""
        self.kept_before = max(self.kept_before, repeat + self._rule.around_alarm + 1)
        held = [each for each in self._held if each.repeat >= repeat - self._rule.around_alarm]
        self._held.clear()
        return held
