"""Has the transient died out? Periods of a capture compared with each other, or with the delay block before."""

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.layout import Capture, Layout

LARGEST_TRANSIENT = 0.01
"""Share of a response's RMS that a transient may still have in a capture."""

SMALLEST_DECAY = 3.0
"""Power in the first quarter of a difference of two periods over that in its last: noise alone has 1."""

_QUARTERS = 4


class PeriodicityCheck:
    """Compares the first period of every capture with the one before or after it, in bounded memory.

    Two periods of the steady state are alike; a transient makes the earlier one differ, and the difference decays.
    Where a capture has several periods its first two are compared, so the difference is what the first one holds.
    Where it has one, it is compared with the last delay block, and the decay seen is carried on into the capture.

    Parameters
    ----------
    layout
        Of a periodic experiment; nothing is checked of another, nor where nothing was played before a single period.
    responses
        Channels, 1 or more.
    """

    def __init__(self, layout: Layout, *, responses: int) -> None:
        self._layout = layout
        self._position = 0
        block = layout.block_samples
        self._waiting: list[tuple[Capture, int]] = []
        if layout.periodic:
            for capture in layout.captures:
                if capture.periods > 1:
                    self._waiting.append((capture, capture.start))
                elif layout.delay_blocks > 0 and capture.start >= block:
                    self._waiting.append((capture, capture.start - block))
        self._pair = np.empty((responses, 2 * block))
        self._difference = np.zeros((responses, _QUARTERS))
        self._carried = np.zeros(responses)
        self._power = np.zeros(responses)

    def add(self, response: NDArray[np.float64]) -> None:
        """Take the next samples of the whole record.

        Parameters
        ----------
        response
            Shape (responses, samples).
        """
        first, last = self._position, self._position + response.shape[1]
        self._position = last
        length = self._pair.shape[1]
        while self._waiting:
            capture, start = self._waiting[0]
            low, high = max(start, first), min(start + length, last)
            if low < high:
                self._pair[:, low - start : high - start] = response[:, low - first : high - first]
            if last < start + length:
                return
            self._take(capture)
            self._waiting.pop(0)

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Judge the captures so far.

        Returns
        -------
        tuple of ModelWarning
            One for each response whose transient is more than a hundredth of its RMS.
        """
        decay = _ratio(self._difference[:, 0], self._difference[:, -1])
        share = np.sqrt(_ratio(self._carried, self._power))
        left = (decay >= SMALLEST_DECAY) & (share > LARGEST_TRANSIENT)
        return tuple(self._warning(int(row), float(share[row])) for row in np.flatnonzero(left))

    def _take(self, capture: Capture) -> None:
        block = self._layout.block_samples
        earlier, later = self._pair[:, :block], self._pair[:, block:]
        cut = block // _QUARTERS * _QUARTERS
        difference = earlier[:, :cut] - later[:, :cut]
        power = np.mean(difference.reshape(difference.shape[0], _QUARTERS, -1) ** 2, axis=2)
        self._difference += power
        self._power += np.var(later, axis=1)
        if capture.periods > 1:
            self._carried += np.mean(power, axis=1)
        else:
            # What decayed by this much over three quarters goes on decaying so in the four of the capture.
            by_quarter = np.clip(_ratio(power[:, -1], power[:, 0]), 0.0, 1.0) ** (1.0 / (_QUARTERS - 1))
            self._carried += power[:, -1] * np.mean(by_quarter[:, None] ** np.arange(1, _QUARTERS + 1), axis=1)

    def _warning(self, row: int, share: float) -> ModelWarning:
        return ModelWarning(
            WarningCode.TRANSIENT,
            f"The capture blocks of response {row} are not yet periodic: a transient of {100.0 * share:.3g} % of its "
            f"RMS is left, at most {100.0 * LARGEST_TRANSIENT:g} % is good; take more than "
            f"{self._layout.delay_blocks} delay blocks.",
            channel=row,
            size=min(share, 1.0),
        )


def _ratio(above: NDArray[np.float64], below: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quotient, 0 where nothing stands above; where nothing stands below, as large as can be said."""
    largest = np.full(above.shape, 1.0 / np.finfo(np.float64).eps)
    return np.where(
        above == 0.0, 0.0, np.minimum(np.divide(above, below, out=largest.copy(), where=below > 0.0), largest)
    )
