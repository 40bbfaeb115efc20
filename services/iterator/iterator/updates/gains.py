"""Iteration gains: per response channel, per frequency, and scheduled over the playbacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class GainCurve:
    """Gain over frequency, straight lines between points, level beyond the first and the last.

    Parameters
    ----------
    frequency : ndarray, shape (points,)
        Hz, rising.
    share : ndarray, shape (points, n_y)
        Of each response's iteration gain, each in (0, 1].

    Raises
    ------
    ValueError
        Shapes do not fit, frequencies do not rise, or a share is not in (0, 1].
    """

    frequency: NDArray[np.float64]
    share: NDArray[np.float64]

    def __post_init__(self) -> None:
        frequency = np.asarray(self.frequency, dtype=np.float64)
        share = np.asarray(self.share, dtype=np.float64)
        if frequency.ndim != 1 or share.ndim != 2 or share.shape[0] != frequency.size or share.size == 0:
            raise ValueError(
                f"The gain curve has frequencies of shape {frequency.shape} and shares of shape {share.shape}; it "
                "needs (points,) and (points, responses)."
            )
        if not (np.all(np.isfinite(frequency)) and np.all(np.diff(frequency) > 0.0)):
            raise ValueError(
                f"The gain curve's frequencies are {', '.join(f'{each:g}' for each in frequency)} Hz; they must be "
                "finite and rise from point to point."
            )
        require_shares(share.ravel(), what="share of the gain curve")
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "share", share)

    def at(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shares at other frequencies.

        Parameters
        ----------
        frequency : ndarray, shape (lines,)
            Hz.

        Returns
        -------
        ndarray, shape (lines, n_y)
            In (0, 1].
        """
        return np.stack([np.interp(frequency, self.frequency, of_channel) for of_channel in self.share.T], axis=1)


def require_shares(values: NDArray[np.float64], *, what: str) -> None:
    """Refuse gains outside (0, 1].

    Parameters
    ----------
    values : ndarray, shape (n,)
        One after the other.
    what : str
        What one of them is called.

    Raises
    ------
    ValueError
        One of them is 0 or less, above 1 or not a number.
    """
    wrong = np.flatnonzero(~((values > 0.0) & (values <= 1.0)))
    if wrong.size:
        raise ValueError(f"The {what} {wrong[0]} is {values[wrong[0]]:g}; it must be above 0 and at most 1.")


def gain_at(
    frequency: NDArray[np.float64],
    *,
    iteration_gain: NDArray[np.float64],
    curve: GainCurve | None,
    schedule: tuple[float, ...],
    playbacks: int,
) -> NDArray[np.float64]:
    """Diagonal of `Q` of the next update at each line.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Hz.
    iteration_gain : ndarray, shape (n_y,)
        `q_i`, each in (0, 1].
    curve : GainCurve, optional
        Shares of it over frequency.
    schedule : tuple of float
        Shares of it for the first drive, the second, and so on; the last one holds on.
    playbacks : int
        Made so far, 0 or more.

    Returns
    -------
    ndarray, shape (lines, n_y)
        Each in (0, 1].
    """
    gain = np.broadcast_to(iteration_gain, (frequency.size, iteration_gain.size))
    gain = gain * schedule[min(playbacks, len(schedule) - 1)]
    return gain if curve is None else gain * curve.at(frequency)
