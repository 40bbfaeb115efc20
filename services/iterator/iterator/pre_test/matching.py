"""Search for inverted or swapped channels, from measured and expected responses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

# A change is clear if the correlation of its channels with the expectation then is this share of the largest possible
# one, and if it gains this much: the correlations of all responses add up to their number at most.
_LIKE: Final = 0.6
_SMALLEST_GAIN: Final = 0.2
# Exponent of the energies of drives that move a response: a weak drive also shows order and sign.
_POWER: Final = 0.5
# Changes with a smaller difference of their gains cannot be distinguished.
_ALIKE: Final = 0.03


@dataclass(frozen=True)
class Change:
    """One channel that is inverted, or two that are swapped; drives or responses."""

    drives: bool
    first: int
    second: int

    @property
    def swaps(self) -> bool:
        """Whether the change is a swap."""
        return self.first != self.second

    def names(self, *, responses: Sequence[str], drives: Sequence[str]) -> tuple[str, ...]:
        """Return the names of its channels."""
        names = drives if self.drives else responses
        return (names[self.first], names[self.second]) if self.swaps else (names[self.first],)

    def sentence(self, *, responses: Sequence[str], drives: Sequence[str]) -> str:
        """Return the change as a sentence without a full stop."""
        names, what = self.names(responses=responses, drives=drives), "drive" if self.drives else "response"
        if self.swaps:
            return f"the {what}s {' and '.join(names)} are swapped"
        return f"the {what} {names[0]} is inverted"


@dataclass(frozen=True)
class ExplainedChange:
    """A change that explains the measured responses, and alternatives with the same effect; one or more."""

    alternatives: tuple[Change, ...]


@dataclass(frozen=True)
class Match:
    """Match of measured to expected responses, with sign and likeness, -1 to 1 or NaN."""

    changes: tuple[ExplainedChange, ...]
    responses: tuple[int, ...]
    sign: tuple[int, ...]
    likeness: NDArray[np.float64]
    drives_changed: bool


@dataclass(frozen=True)
class _Arrangement:
    """Expected response and drive of each measured one, and their signs."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    row_signs: tuple[int, ...]
    column_signs: tuple[int, ...]

    def after(self, change: Change) -> _Arrangement:
        order, signs = ("columns", "column_signs") if change.drives else ("rows", "row_signs")
        values = list(getattr(self, order if change.swaps else signs))
        if change.swaps:
            values[change.first], values[change.second] = values[change.second], values[change.first]
            return replace(self, **{order: tuple(values)})
        values[change.first] *= -1
        return replace(self, **{signs: tuple(values)})

    def of_pairs(self, values: NDArray[np.float64], *, signed: bool = False) -> NDArray[np.float64]:
        """Return the value of each measured pair (response, drive) with its expected pair."""
        rows, columns = np.arange(len(self.rows))[:, None], np.arange(len(self.columns))[None, :]
        chosen = values[rows, columns, np.array(self.rows)[:, None], np.array(self.columns)[None, :]]
        return np.outer(self.row_signs, self.column_signs) * chosen if signed else chosen


def match_channels(
    measured: NDArray[np.float64],
    expected: NDArray[np.float64],
    *,
    amplitude: NDArray[np.float64],
    floor: NDArray[np.float64],
) -> Match:
    """Find inverted and swapped channels, one after the other, the clearest first.

    `measured`, `expected`, shape (responses, drives, samples): In the window of each drive. `amplitude`, shape
    (drives,): Peaks of the pulses. `floor`, shape (responses,): Largest peak of a response that has not moved.
    """
    shapes, wanted = (_shapes(parts * np.sign(amplitude)[:, None], floor) for parts in (measured, expected))
    responses, drives, samples = shapes.shape
    # Every pulse is made positive, so that the effects of two drives can be compared.
    related = (shapes.reshape(-1, samples) @ wanted.reshape(-1, samples).T).reshape(2 * shapes.shape[:2])
    sizes = np.multiply.outer(*(np.sqrt(np.sum(one**2, axis=2)) for one in (shapes, wanted)))
    now = _Arrangement(tuple(range(responses)), tuple(range(drives)), (1,) * responses, (1,) * drives)
    changes: list[ExplainedChange] = []
    for _ in range(responses + drives):
        gains = dict(_clear_gains(now, related, sizes))
        if not gains:
            break
        best = max(gains, key=lambda change: gains[change])
        alike = [change for change, gain in gains.items() if gain > gains[best] - _ALIKE]
        changes.append(ExplainedChange((best, *(change for change in alike if change != best))))
        now = now.after(best)
    likeness = np.where(sizes.any(axis=(1, 2, 3)), now.of_pairs(related, signed=True).sum(axis=1), np.nan)
    drives_changed = now.columns != tuple(range(drives)) or -1 in now.column_signs
    return Match(tuple(changes), now.rows, now.row_signs, likeness, drives_changed)


def _clear_gains(
    now: _Arrangement, related: NDArray[np.float64], sizes: NDArray[np.float64]
) -> Iterator[tuple[Change, float]]:
    """Yield the clear changes, and their gain in likeness to the expected responses."""
    before = now.of_pairs(related, signed=True)
    for change in _changes(*before.shape):
        changed = now.after(change)
        after = changed.of_pairs(related, signed=True)
        gain, axis = float(after.sum() - before.sum()), 1 if change.drives else 0
        channels = sorted({change.first, change.second})
        reached, possible = (pairs.take(channels, axis=axis).sum() for pairs in (after, changed.of_pairs(sizes)))
        if gain >= _SMALLEST_GAIN and reached >= _LIKE * possible:
            yield change, gain


def _changes(responses: int, drives: int) -> Iterator[Change]:
    for of_drives, count in ((False, responses), (True, drives)):
        yield from (Change(of_drives, one, one) for one in range(count))
        yield from (Change(of_drives, first, second) for first, second in combinations(range(count), 2))


def _shapes(parts: NDArray[np.float64], floor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each response in each window, (responses, drives, samples), scaled to an energy of 1 for each response.

    Zero if it has not moved.
    """
    energy = np.sum(parts**2, axis=2)
    moved = (np.abs(parts).max(axis=2) > floor[:, None]) & (energy > 0.0)
    weight = np.where(moved, energy, 0.0) ** _POWER
    whole = weight.sum(axis=1, keepdims=True)
    size = np.sqrt(weight / np.where(whole > 0.0, whole, 1.0))
    return parts * (size / np.sqrt(np.where(moved, energy, 1.0)))[:, :, None]
