"""Transients longer than a block: differences of three successive periods, of which the second is the smaller."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

SMALLEST_RATIO = 1.2
"""Energy of the difference of two periods over that of the next, on the second half of each: noise alone has 1."""

CHANCE = 1e-4
"""Probability that noise alone of any spectrum passes for a transient of a response."""


class SlowTransients:
    """Compares three successive periods of every capture, and judges by the scatter of the captures.

    A free decay with time constant tau shrinks by exp(T / tau) from one difference to the next, T the period, for any
    phase; noise does not shrink. A lightly damped mode that is moved by noise varies widely from one capture to the
    next, so chance is judged by the captures, not the samples: two are needed, and few of them find only clear
    transients.
    """

    def __init__(self) -> None:
        self._energies: list[NDArray[np.float64]] = []

    def add(self, periods: NDArray[np.float64]) -> None:
        """Add the periods of a capture."""
        half = periods.shape[2] // 2
        earlier = periods[:, 0, half:] - periods[:, 1, half:]
        later = periods[:, 1] - periods[:, 2]
        parts = (earlier, later[:, :half], later[:, half:])
        self._energies.append(np.stack([np.mean(part**2, axis=1) for part in parts]))

    def difference_power(self, responses: int) -> NDArray[np.float64]:
        """Return the power of the last two periods' difference that is due to a transient."""
        if len(self._energies) < 2:
            return np.zeros(responses)
        earlier, first_half, second_half = np.moveaxis(np.stack(self._energies), 1, 0)
        total, middle, last = earlier.sum(axis=0), first_half.sum(axis=0), second_half.sum(axis=0)
        # Modes are those of the rig: a transient that is certain in one response is not chance in another.
        found = (total > SMALLEST_RATIO * last) & np.any(_beyond_chance(earlier, second_half))
        # Energies half a period apart are T, T s, T s^2 on top of the noise: their differences have the ratio s. The
        # noise cannot hide more than this, as it makes the decay look slower.
        slowest = np.sqrt(np.divide(last, total, out=np.zeros_like(total), where=found))
        gone, going = total - middle, middle - last
        seen = np.divide(going, gone, out=np.ones_like(gone), where=gone > 0.0)
        decay = np.clip(seen, 0.0, slowest)
        return np.where(found, (total - last) * decay / (2.0 * (1.0 - decay)), 0.0)


def _beyond_chance(earlier: NDArray[np.float64], later: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether energies, shape (captures, responses), shrink by more than their scatter over the captures."""
    known = (earlier > 0.0) & (later > 0.0)
    # A transient that is completely gone was not a slow decay.
    shrinking = np.log(np.divide(earlier, later, out=np.ones_like(earlier), where=known))
    captures = shrinking.shape[0]
    error = np.std(shrinking, axis=0, ddof=1) / np.sqrt(captures)
    return np.mean(shrinking, axis=0) > stdtrit(captures - 1, 1.0 - CHANCE) * error
