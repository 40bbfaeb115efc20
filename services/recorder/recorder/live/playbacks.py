"""Name of a playback in the live view: iteration and attempt.

A motion that a crash interrupted is requested again under a new run name: `<id>.i02-2` after `<id>.i02`. Curves cannot
be removed once drawn, and a failure is not known beforehand, so each attempt has separate curves; the legend's plain
name is that of the newest attempt.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_ITERATION = re.compile(r"i(?P<number>\d{1,6})(-(?P<attempt>\d{1,6}))?")


@dataclass(frozen=True)
class Playback:
    """A playback and its name in the view.

    `name`: Name in the legend: "iteration 02", or the run's name within its campaign. `attempt`: From 1.
    `is_iteration`: Whether the target's drive is played.
    """

    name: str
    attempt: int = 1
    is_iteration: bool = False

    @property
    def entity(self) -> str:
        """Last part of its curves' paths: "iteration 02", and "iteration 02-2" for the second attempt."""
        return self.name if self.attempt == 1 else f"{self.name}-{self.attempt}"

    def repeats(self, other: Playback) -> bool:
        """Return whether it is another attempt at the same playback."""
        return self.name == other.name and self.attempt != other.attempt


def playback_of(run: str, *, recording: str) -> Playback:
    """Return the playback of a run."""
    own = run.removeprefix(f"{recording}.")
    match = _ITERATION.fullmatch(own)
    return Playback(own) if match is None else iteration(int(match["number"]), attempt=int(match["attempt"] or 1))


def iteration(number: int, *, attempt: int = 1) -> Playback:
    """Return the playback of an attempt at an iteration."""
    # Two digits, because the viewer sorts alphabetically.
    return Playback(f"iteration {number:02d}", attempt, is_iteration=True)
