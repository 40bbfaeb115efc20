"""Check for remaining transients: periods of a capture compared with each other, or with the delay block before."""

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.estimators.slow_transients import SlowTransients
from identifier.layout import Capture, Layout

LARGEST_TRANSIENT = 0.01
"""Largest transient in a capture as a share of a response's RMS."""

SMALLEST_DECAY = 3.0
"""Power in the first quarter of a difference of two periods over that in its last: noise alone has 1."""

_QUARTERS = 4

_COMPARED = 3
"""Number of successive periods that distinguish a slow transient from noise."""


class PeriodicityCheck:
    """Compares the first period of every capture with the one before or after it, in bounded memory.

    Two periods of the steady state are equal; a transient makes the earlier one differ, and the difference decays.
    If a capture has several periods its first two are compared, so the difference is the transient in the first one. If
    it has one, it is compared with the last delay block, and the decay is extrapolated into the capture.
    A transient longer than a block hardly decays within it: it shows in the next period, see `SlowTransients`. That
    needs three successive periods and two captures: in captures of a single period it remains undetected.

    `layout`: Layout of a periodic experiment; other experiments are not checked, nor single periods without an earlier
    playback. `responses`: Number of channels, 1 or more.
    """

    def __init__(self, layout: Layout, *, responses: int) -> None:
        self._layout = layout
        self._position = 0
        self._waiting = _stretches(layout) if layout.periodic else []
        self._periods = np.empty((responses, _COMPARED * layout.block_samples))
        self._slow = SlowTransients()
        self._difference = np.zeros((responses, _QUARTERS))
        self._carried = np.zeros(responses)
        self._power = np.zeros(responses)

    def add(self, response: NDArray[np.float64]) -> None:
        """Add the next samples of the whole record."""
        first, last = self._position, self._position + response.shape[1]
        self._position = last
        while self._waiting:
            capture, start, stop = self._waiting[0]
            low, high = max(start, first), min(stop, last)
            if low < high:
                self._periods[:, low - start : high - start] = response[:, low - first : high - first]
            if last < stop:
                return
            self._take(capture, start, stop)
            self._waiting.pop(0)

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Return the warnings about the captures so far."""
        decay = _ratio(self._difference[:, 0], self._difference[:, -1])
        share = np.sqrt(_ratio(self._carried, self._power))
        slow_share = np.sqrt(_ratio(self._slow.difference_power(share.size), self._power))
        left = np.where(decay >= SMALLEST_DECAY, np.maximum(share, slow_share), slow_share)
        return tuple(self._warning(int(row), float(left[row])) for row in np.flatnonzero(left > LARGEST_TRANSIENT))

    def _take(self, capture: Capture, start: int, stop: int) -> None:
        block = self._layout.block_samples
        periods = self._periods[:, : stop - start].reshape(self._power.size, -1, block)
        if periods.shape[1] == _COMPARED:
            self._slow.add(periods)
        pair = capture.start - start if capture.periods > 1 else 0
        earlier, later = periods[:, pair // block], periods[:, pair // block + 1]
        cut = block // _QUARTERS * _QUARTERS
        difference = earlier[:, :cut] - later[:, :cut]
        power = np.mean(difference.reshape(difference.shape[0], _QUARTERS, -1) ** 2, axis=2)
        self._difference += power
        self._power += np.var(later, axis=1)
        if capture.periods > 1:
            self._carried += np.mean(power, axis=1)
        else:
            # A decay over three quarters is assumed to continue in the four of the capture.
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


def _stretches(layout: Layout) -> list[tuple[Capture, int, int]]:
    """Return captures with first and last sample of the compared periods: three if possible, or two."""
    block = layout.block_samples
    # The second half of the delay block is used, so the fade must be over there.
    faded_in = layout.delay_blocks * block - layout.fade_samples >= block // 2
    stretches = []
    for capture in layout.captures:
        delayed = layout.delay_blocks > 0 and capture.start >= block
        if capture.periods == 1:
            if delayed:
                stretches.append((capture, capture.start - block, capture.start + block))
            continue
        first = capture.start - block if delayed and faded_in else capture.start
        stop = min(first + _COMPARED * block, capture.start + capture.periods * block)
        stretches.append((capture, first, stop))
    return stretches


def _ratio(above: NDArray[np.float64], below: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quotient, 0 for a numerator of 0; for a denominator of 0 the largest representable value."""
    largest = np.full(above.shape, 1.0 / np.finfo(np.float64).eps)
    return np.where(
        above == 0.0, 0.0, np.minimum(np.divide(above, below, out=largest.copy(), where=below > 0.0), largest)
    )
