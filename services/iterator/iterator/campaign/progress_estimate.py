"""Progress and remaining time of a campaign, from the durations of its steps so far."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

# Below this share of a step, its elapsed time does not predict its end.
_SMALLEST_SHARE = 0.05


@dataclass(frozen=True)
class Progress:
    """Progress of a campaign.

    `fraction`: Share of the whole campaign that is done, 0 to 1, by played duration. `remaining_seconds`:
    Expected time to the end, s; -1 where unknown.
    """

    fraction: float
    remaining_seconds: float


class ProgressEstimate:
    """Follows the identification and the iterations of one campaign; used by one thread.

    An iteration is expected to last as long as the earlier ones; before the first, as long per played second as the
    identification.

    `identification_seconds`, `playback_seconds`: Played duration of the identification and of each iteration, s,
    greater than 0. `iterations`: Largest number of playbacks of the target. `clock`: Returns a monotonic time in s.
    """

    def __init__(
        self,
        *,
        identification_seconds: float,
        playback_seconds: float,
        iterations: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._identification_seconds = identification_seconds
        self._playback_seconds = playback_seconds
        self._iterations = iterations
        self._clock = clock
        self._step_began = clock()
        self._identified = False
        self._done = 0
        self._identification_lasted: float | None = None
        self._iterations_lasted: list[float] = []

    def step_done(self) -> None:
        """Record that the identification, or after it an iteration, is done and the next begins."""
        now = self._clock()
        lasted, self._step_began = now - self._step_began, now
        if not self._identified:
            self._identified, self._identification_lasted = True, lasted
        else:
            self._done += 1
            self._iterations_lasted.append(lasted)

    def waited(self, seconds: float) -> None:
        """Exclude the time that the campaign waited for a person."""
        self._step_began += seconds

    def step_was_done(self) -> None:
        """Record that the identification, or after it an iteration, was done before, in an unknown time."""
        self._step_began = self._clock()
        if not self._identified:
            self._identified = True
        else:
            self._done += 1

    def at(self, share: float) -> Progress:
        """Return the progress of the campaign at a share of the present step."""
        total = self._identification_seconds + self._iterations * self._playback_seconds
        if not self._identified:
            played = share * self._identification_seconds
        else:
            played = self._identification_seconds + (self._done + share) * self._playback_seconds
        return Progress(fraction=min(1.0, played / total), remaining_seconds=self._remaining(share))

    def _remaining(self, share: float) -> float:
        elapsed = self._clock() - self._step_began
        by_share = elapsed / share if share >= _SMALLEST_SHARE else None
        ratio = self._playback_seconds / self._identification_seconds
        if not self._identified:
            if by_share is None:
                return -1.0
            return by_share - elapsed + self._iterations * by_share * ratio
        if self._iterations_lasted:
            expected = sum(self._iterations_lasted) / len(self._iterations_lasted)
        elif by_share is not None:
            expected = by_share
        elif self._identification_lasted is not None:
            expected = self._identification_lasted * ratio
        else:
            return -1.0
        return max(0.0, expected - elapsed) + max(0, self._iterations - self._done - 1) * expected
