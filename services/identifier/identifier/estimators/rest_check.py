"""Check for rest before the next burst: ringing leaks into the next block, and no window removes it."""

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.estimators.periodicity import LARGEST_TRANSIENT, SMALLEST_DECAY
from identifier.layout import Layout, Window

LARGEST_UNREST = 0.1
"""Largest remainder at the end of a block without a decay, as a share of a response's RMS: noise, as a rule, but a
mode that hardly decays in a rest looks the same."""

_QUARTERS = 4

_SHORTEST_REST = 8
"""Largest ratio of block to rest: a shorter rest is not judged."""


class RestCheck:
    """Checks the rest after every burst or sweep, in the memory of a block.

    A ringing response decays from the third quarter of the rest to its last, and is assumed to continue so into the
    next block. Noise does not decay.

    `layout`: Layout of bursts or sweeps, a block each; others are not checked. `drives`, `responses`: Numbers of
    channels, 1 or more.
    """

    def __init__(self, layout: Layout, *, drives: int, responses: int) -> None:
        self._active = not layout.periodic and layout.window is Window.NONE
        size = layout.block_samples if self._active else 0
        self._drive, self._response = np.empty((drives, size)), np.empty((responses, size))
        self._filled = 0
        self._third = np.zeros(responses)
        self._last = np.zeros(responses)
        self._power = np.zeros(responses)
        self._blocks_over_rest = 0.0

    def add(self, drive: NDArray[np.float64], response: NDArray[np.float64]) -> None:
        """Add the next used samples."""
        size, taken = self._drive.shape[1], 0
        while self._active and taken < drive.shape[1]:
            piece = min(size - self._filled, drive.shape[1] - taken)
            self._drive[:, self._filled : self._filled + piece] = drive[:, taken : taken + piece]
            self._response[:, self._filled : self._filled + piece] = response[:, taken : taken + piece]
            self._filled, taken = self._filled + piece, taken + piece
            if self._filled == size:
                self._take()
                self._filled = 0

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Return the warnings about the blocks so far."""
        if not self._power.any():
            return ()
        power = np.where(self._power > 0.0, self._power, 1.0)
        left = np.sqrt(self._last / power)
        by_quarter = np.divide(self._last, self._third, out=np.ones_like(power), where=self._third > 0.0)
        by_quarter = np.minimum(by_quarter, 1.0)
        decaying = by_quarter ** (_QUARTERS - 1) <= 1.0 / SMALLEST_DECAY
        quarters = np.arange(1, round(_QUARTERS * self._blocks_over_rest) + 1)
        carried = left * np.sqrt(np.mean(by_quarter[:, None] ** quarters, axis=1))
        return tuple(
            _warning(row, float(carried[row] if decaying[row] else left[row]), decaying=bool(decaying[row]))
            for row in range(power.size)
            if (decaying[row] and carried[row] > LARGEST_TRANSIENT) or left[row] > LARGEST_UNREST
        )

    def _take(self) -> None:
        """Add the power of a block, and of the third and the last quarter of its rest."""
        moving = np.flatnonzero(np.any(self._drive != self._drive[:, -1:], axis=0))
        begin = int(moving[-1]) + 1 if moving.size else 0
        size = self._drive.shape[1]
        if not 0 < begin <= size - max(size // _SHORTEST_REST, _QUARTERS):
            return
        quarter = (size - begin) // _QUARTERS
        self._blocks_over_rest = size / (size - begin)
        self._third += np.var(self._response[:, size - 2 * quarter : size - quarter], axis=1)
        self._last += np.var(self._response[:, size - quarter :], axis=1)
        self._power += np.var(self._response, axis=1)


def _warning(row: int, share: float, *, decaying: bool) -> ModelWarning:
    what = (
        f"rings on into the next one with {100.0 * share:.3g} % of its RMS, at most {100.0 * LARGEST_TRANSIENT:g} % is "
        "good"
        if decaying
        else f"has {100.0 * share:.3g} % of its RMS left at its end, which is noise or rings on undamped"
    )
    return ModelWarning(
        WarningCode.TRANSIENT,
        f"After each burst or sweep response {row} {what}; take longer blocks or a smaller share of them.",
        channel=row,
        size=min(share, 1.0),
    )
