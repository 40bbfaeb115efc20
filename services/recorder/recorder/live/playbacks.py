"""Name of a playback in the live view: iteration and attempt.

A motion that a crash broke off is asked for again under a new run name: `<id>.i02-2` after `<id>.i02`. What is drawn
cannot be taken back and nobody knows beforehand that an attempt will fail, so each attempt has curves of its own; the
legend's plain name goes to the newest one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_ITERATION = re.compile(r"i(?P<number>\d{1,6})(-(?P<attempt>\d{1,6}))?")


@dataclass(frozen=True)
class Playback:
    """A playback, as the view names it.

    `name`: In the legend: "iteration 02", or the run's own name within its campaign. `attempt`: From 1. `is_iteration`:
    Whether the target's drive is played.
    """

    name: str
    attempt: int = 1
    is_iteration: bool = False

    @property
    def entity(self) -> str:
        """The last part of its curves' paths: "iteration 02", and "iteration 02-2" for the second attempt."""
        return self.name if self.attempt == 1 else f"{self.name}-{self.attempt}"

    def repeats(self, other: Playback) -> bool:
        """Whether it is another attempt at the same."""
        return self.name == other.name and self.attempt != other.attempt


def playback_of(run: str, *, recording: str) -> Playback:
    """Return what a run is called."""
    own = run.removeprefix(f"{recording}.")
    match = _ITERATION.fullmatch(own)
    return Playback(own) if match is None else iteration(int(match["number"]), attempt=int(match["attempt"] or 1))


def iteration(number: int, *, attempt: int = 1) -> Playback:
    """Return what an attempt at an iteration is called."""
    # Two digits, because the viewer sorts by letters.
    return Playback(f"iteration {number:02d}", attempt, is_iteration=True)
