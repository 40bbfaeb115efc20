"""In which order events are made, and which one each starts from: similar ones follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_BANDS: Final = 24
"""Bands of equal ratio in which spectra of targets are compared, whatever the lengths of the targets."""
_QUIETEST: Final = 1e-6
"""Share of a channel's strongest band below which a band counts as this quiet."""
RESEMBLES: Final = 0.5
"""Share of a target's energy that a scaled other one has to explain, so that its drive is worth starting from."""


@dataclass(frozen=True)
class Likeness:
    """Likeness of targets.

    `distance`, shape (targets, targets): 0 for one that another scaled is, and more for others. `explained`, shape
    (targets, targets): Share of the energy of the target of the column that the one of the row, scaled, explains.
    """

    distance: NDArray[np.float64]
    explained: NDArray[np.float64]


def likeness(targets: Sequence[NDArray[np.float64]], *, sample_rate: float, band: tuple[float, float]) -> Likeness:
    """Compare targets of one rig in a band, channels in one order, of any lengths.

    The distance is the RMS difference of their spectra in dB, over channels and bands of equal ratio, times the root of
    the share of the energy that the scaled other one leaves unexplained, sample by sample from the start.
    """
    longest = max(target.shape[1] for target in targets)
    frequency = np.fft.rfftfreq(longest, 1.0 / sample_rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    lines = [np.fft.rfft(target, longest, axis=1)[:, inside] for target in targets]
    edges = np.geomspace(max(band[0], frequency[inside][0], 1.0 / longest), band[1], _BANDS + 1)
    which = np.clip(np.searchsorted(edges, frequency[inside], side="right") - 1, 0, _BANDS - 1)
    used = np.unique(which)
    levels = []
    for target, spectrum in zip(targets, lines, strict=True):
        power = np.stack([np.mean(np.abs(spectrum[:, which == each]) ** 2, axis=1) for each in used], axis=1)
        power /= target.shape[1]
        floor = np.maximum(_QUIETEST * power.max(axis=1, keepdims=True), np.finfo(np.float64).tiny)
        levels.append(10.0 * np.log10(np.maximum(power, floor)))
    count = len(targets)
    decibels, explained = np.zeros((count, count)), np.ones((count, count))
    for i in range(count):
        for j in range(count):
            decibels[i, j] = np.sqrt(np.mean((levels[i] - levels[j]) ** 2))
            explained[i, j] = _explained(lines[i], lines[j])
    return Likeness(decibels * np.sqrt(1.0 - explained), explained)


def _explained(by: NDArray[np.complex128], wanted: NDArray[np.complex128]) -> float:
    """Return the share of energy that the best scaled record explains; each channel over its RMS in the wanted one."""
    energy = np.sum(np.abs(wanted) ** 2, axis=1)
    weight = np.divide(1.0, energy, out=np.zeros_like(energy), where=energy > 0.0)
    product = float(weight @ np.sum((by.conj() * wanted).real, axis=1))
    own = float(weight @ np.sum(np.abs(by) ** 2, axis=1))
    whole = float(weight @ energy)
    return min(1.0, product**2 / (own * whole)) if own > 0.0 and whole > 0.0 and product > 0.0 else 0.0


def ordered(distance: NDArray[np.float64], priorities: Sequence[int]) -> list[int]:
    """Return the order of events: by priority; among equals the most typical first, then the nearest to one before."""
    left, order = set(range(len(priorities))), list[int]()
    while left:
        highest = max(priorities[i] for i in left)
        candidates = sorted(i for i in left if priorities[i] == highest)
        far = [distance[order, i].min() if order else distance[:, i].sum() for i in candidates]
        chosen = candidates[int(np.argmin(far))]
        order.append(chosen)
        left.remove(chosen)
    return order


def nearest(distance: NDArray[np.float64], event: int, among: Sequence[int], *, most: int) -> list[int]:
    """Return the events nearest to one, the nearest last: an update minds what it learned last the most."""
    return sorted(among, key=lambda i: (distance[i, event], i))[:most][::-1]
