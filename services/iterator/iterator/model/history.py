"""What an update may know: the target and every playback so far."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    target: NDArray[np.float64]
    playbacks: tuple[Playback, ...] = ()

    def after(self, playback: Playback) -> IterationHistory:
        """Return the history with one more playback."""
        return IterationHistory(target=self.target, playbacks=(*self.playbacks, playback))
