"""Repeats and damage of each event so far: measured, or planned if the end of a repeat is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass
class EventTally:
    """Repeats and damage of one event.

    `planned`: Repeats of the schedule. `planned_damage`, shape (responses,): Damage of one repeat; None if the schedule
    names no target. `played`, `unknown`: Counted repeats, and those of them with an unknown end. `damage`,
    `measured_damage`, shape (responses,): Counted damage, that of corrections included, and that of the measured
    repeats. `correction_playbacks`, `correction_damage`: Playbacks of campaigns that corrected the drive, and their
    part of `damage`. `drive`: Index of the drive in use.
    """

    planned: int
    planned_damage: NDArray[np.float64] | None
    damage: NDArray[np.float64]
    measured_damage: NDArray[np.float64]
    correction_damage: NDArray[np.float64]
    correction_playbacks: int = 0
    played: int = 0
    unknown: int = 0
    measured: int = 0
    drive: int = 0

    @classmethod
    def begun(cls, planned: int, planned_damage: NDArray[np.float64] | None, *, responses: int) -> EventTally:
        """Return the tally of an event without any repeat."""
        return cls(planned, planned_damage, np.zeros(responses), np.zeros(responses), np.zeros(responses))

    def count_measured(self, damage: NDArray[np.float64]) -> None:
        """Count a repeat that was played to its end."""
        self.played += 1
        self.measured += 1
        self.damage = self.damage + damage
        self.measured_damage = self.measured_damage + damage

    def count_unknown(self) -> NDArray[np.float64] | None:
        """Count a repeat with an unknown end; return its damage, None if it cannot be estimated."""
        damage = self.damage_per_repeat
        self.played += 1
        self.unknown += 1
        if damage is not None:
            self.damage = self.damage + damage
        return damage

    def count_correction(self, playbacks: int, damage: NDArray[np.float64] | None) -> None:
        """Count the playbacks of a campaign that corrected the drive; `damage`: None if none is known."""
        self.correction_playbacks += playbacks
        if damage is not None:
            self.damage = self.damage + damage
            self.correction_damage = self.correction_damage + damage

    @property
    def damage_per_repeat(self) -> NDArray[np.float64] | None:
        """Damage of one repeat as planned, or the mean of the measured ones; None before the first of these."""
        if self.planned_damage is not None:
            return self.planned_damage
        return self.measured_damage / self.measured if self.measured else None


def total_damage(events: Sequence[EventTally]) -> NDArray[np.float64]:
    """Return the counted damage, shape (responses,)."""
    return np.sum([event.damage for event in events], axis=0)


def correction_damage(events: Sequence[EventTally]) -> NDArray[np.float64]:
    """Return the damage of the campaigns that corrected drives, shape (responses,); part of `total_damage`."""
    return np.sum([event.correction_damage for event in events], axis=0)


def planned_damage(events: Sequence[EventTally], *, whole: bool) -> NDArray[np.float64] | None:
    """Return the planned damage of the whole schedule or of its played part; None if that of an event is unknown."""
    planned = np.zeros(events[0].damage.size)
    for event in events:
        per_repeat = event.damage_per_repeat
        if per_repeat is None:
            if event.planned if whole else event.played:
                return None
            continue
        planned = planned + per_repeat * (event.planned if whole else event.played)
    return planned
