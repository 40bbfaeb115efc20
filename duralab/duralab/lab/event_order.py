"""Order of a project's events, and the event that each starts from: similar events follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_BANDS: Final = 24
"""Number of bands of equal ratio for comparing spectra of targets, for targets of any length."""
_QUIETEST: Final = 1e-6
"""Lower bound of a band's power, as a share of the channel's strongest band."""
RESEMBLES: Final = 0.5
"""Share of a target's energy that another target, scaled, must explain so that its drive is a useful start."""


@dataclass(frozen=True)
class Likeness:
    """Similarity of targets.

    `distance`, shape (targets, targets): 0 if one target is a scaled copy of the other, larger otherwise. `explained`,
    shape (targets, targets): Share of the energy of the column's target that the row's target, scaled, explains.
    """

    distance: NDArray[np.float64]
    explained: NDArray[np.float64]


def likeness(targets: Sequence[NDArray[np.float64]], *, sample_rate: float, band: tuple[float, float]) -> Likeness:
    """Compare targets of one rig in a band; they have the same order of channels and any lengths.

    The distance is the RMS difference of their spectra in dB, over channels and bands of equal ratio, times the root of
    the share of the energy that the other target, scaled, does not explain, sample by sample from the start.
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
    """Return the share of energy explained at the best scale; each channel is divided by its RMS in `wanted`."""
    energy = np.sum(np.abs(wanted) ** 2, axis=1)
    weight = np.divide(1.0, energy, out=np.zeros_like(energy), where=energy > 0.0)
    product = float(weight @ np.sum((by.conj() * wanted).real, axis=1))
    own = float(weight @ np.sum(np.abs(by) ** 2, axis=1))
    whole = float(weight @ energy)
    return min(1.0, product**2 / (own * whole)) if own > 0.0 and whole > 0.0 and product > 0.0 else 0.0


def ordered(distance: NDArray[np.float64], priorities: Sequence[int]) -> list[int]:
    """Return the order of events: by priority; among equals first the most typical, then the nearest to any before."""
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
    """Return the events nearest to `event`, the nearest last: the latest data has the most effect on an update."""
    return sorted(among, key=lambda i: (distance[i, event], i))[:most][::-1]
