"""History for an update: the target and every playback so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Playback:
    """One drive that was played, and what came back.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        As played, or its mapped drive where the campaign has a drive map; drive units.
    response : ndarray, shape (n_y, samples)
        In the control band, as it is judged, response units.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]


@dataclass(frozen=True)
class IterationHistory:
    """Target and playbacks of a campaign, in order.

    Parameters
    ----------
    target : ndarray, shape (n_y, samples)
        In the control band, response units.
    playbacks : tuple of Playback
        From the first to the last; empty before the first.
    start : Playback, optional
        Drive to make the first step from, and the response that it is taken to give; rest where not given.
    """

    target: NDArray[np.float64]
    playbacks: tuple[Playback, ...] = ()
    start: Playback | None = None

    @property
    def last(self) -> Playback | None:
        """The playback that the next step goes from: the last one, or before the first the start; None for rest."""
        return self.playbacks[-1] if self.playbacks else self.start

    def after(self, playback: Playback) -> IterationHistory:
        """Return the history with one more playback."""
        return replace(self, playbacks=(*self.playbacks, playback))
