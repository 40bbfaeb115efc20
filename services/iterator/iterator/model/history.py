"""History for an update: the target and every playback so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Playback:
    """A played drive and its response.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Drive as played, or its mapped drive if the campaign has a drive map; drive units.
    response : ndarray, shape (n_y, samples)
        Judged response in the control band, response units.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]


@dataclass(frozen=True)
class IterationHistory:
    """Target and playbacks of a campaign, in order.

    Parameters
    ----------
    target : ndarray, shape (n_y, samples)
        Target in the control band, response units.
    playbacks : tuple of Playback
        Playbacks from the first to the last; empty before the first.
    start : Playback, optional
        Drive of the first step's start, and its assumed response; rest if not given.
    """

    target: NDArray[np.float64]
    playbacks: tuple[Playback, ...] = ()
    start: Playback | None = None

    @property
    def last(self) -> Playback | None:
        """Playback that the next step starts from: the last one, or before the first the start; None for rest."""
        return self.playbacks[-1] if self.playbacks else self.start

    def after(self, playback: Playback) -> IterationHistory:
        """Return the history with one more playback."""
        return replace(self, playbacks=(*self.playbacks, playback))
