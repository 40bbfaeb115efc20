"""Shortening of a load history to the sections that carry its damage."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_loads.fades import join_sections, separate_sections
from duralab_loads.load_cycles import count_load_cycles, pseudo_damage
from duralab_spectra import as_record

_TIGHTEN = 0.7
"""Factor by which the allowed loss shrinks if the joined sections keep less than requested."""

_MOST_TRIES = 60
"""Number of tries, after which the allowed loss is 5e-10 of its start: every window with damage is kept."""


@dataclass(frozen=True)
class Shortened:
    """A load history without the sections that do little damage.

    Parameters
    ----------
    samples : ndarray, shape (channels, kept samples)
        Sections, joined with cross-fades.
    sections : tuple of tuple of int
        First sample and the one after the last of each section, with its fades, in the given record.
    kept : ndarray, shape (channels)
        Pseudo-damage of the result over that of the record, counted again; nan for a constant channel.
    """

    samples: NDArray[np.float64]
    sections: tuple[tuple[int, int], ...]
    kept: NDArray[np.float64]


def damage_over_time(signal: ArrayLike, *, exponent: float) -> NDArray[np.float64]:
    """Return the share of a signal's pseudo-damage at each sample.

    Parameters
    ----------
    signal : array_like, shape (samples)
        Finite signal.
    exponent : float
        Slope of the S-N line, greater than 0.

    Returns
    -------
    ndarray, shape (samples)
        Share at each sample: half of each cycle's damage at its valley and half at its peak; the sum is 1, or 0 for a
        constant signal.
    """
    values = np.asarray(signal, dtype=np.float64)
    unit = float(np.ptp(values))
    if unit == 0.0:
        return np.zeros(values.size)
    # In units of the largest range: the power of a force in newtons is too large to sum.
    cycles = count_load_cycles(values / unit)
    damage = cycles.counts * cycles.ranges**exponent
    ends = np.concatenate([cycles.starts, cycles.ends])
    return np.bincount(ends, weights=np.tile(0.5 * damage, 2), minlength=values.size) / damage.sum()


def shorten_by_damage(
    samples: ArrayLike, *, keep: float, exponent: float, window_samples: int, fade_samples: int
) -> Shortened:
    """Keep the windows that carry the damage of every channel and join them.

    Windows are chosen greedily: next is the one that brings the channels closest to the requested share. The damage
    of the joined windows is then counted again, and windows are added until every channel keeps its share.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    keep : float
        Least share of each channel's damage, above 0 to 1.
    exponent : float
        Slope of the S-N line, greater than 0.
    window_samples : int
        Length of a window, 1 or more.
    fade_samples : int
        Length of a cross-fade, 0 or more; it is taken from outside the kept windows.

    Returns
    -------
    Shortened
        Shortened record, with the same sections regardless of the order and the units of the channels.

    Raises
    ------
    ValueError
        If a share, exponent or length is not allowed, or no channel of the record moves.

    Notes
    -----
    Source: damage editing after Stephens, Dindinger and Gunger, "Fatigue damage editing for accelerated durability
    testing" (Int. J. Fatigue, 1997), for several channels at once; rainflow of ASTM E1049-85; Miner (1945).
    """
    record = as_record(samples)
    if not 0.0 < keep <= 1.0:
        raise ValueError(f"The damage to keep is {keep:g}; it must be above 0 to 1.")
    if not (np.isfinite(exponent) and exponent > 0.0):
        raise ValueError(f"The exponent of the S-N line is {exponent:g}; it must be finite and greater than 0.")
    if window_samples < 1 or fade_samples < 0:
        raise ValueError(
            f"The window is {window_samples} samples and the cross-fade {fade_samples}; 1 and 0 are the least."
        )
    moving = np.ptp(record, axis=1) > 0.0
    if not moving.any():
        raise ValueError("No channel moves, so there is no damage to shorten by; leave the step out.")
    edges = [*range(0, record.shape[1], window_samples), record.shape[1]]
    shares = np.stack([np.add.reduceat(damage_over_time(row, exponent=exponent), edges[:-1]) for row in record[moving]])
    wanted = keep
    for _ in range(_MOST_TRIES):
        windows = _windows_to_keep(shares, keep=wanted)
        whole = _runs(windows, edges=edges)
        sections = separate_sections(whole, fade_samples=fade_samples, samples=record.shape[1])
        joined = join_sections(record, sections, fade_samples=fade_samples)
        kept = _damage_kept(record, joined, exponent=exponent)
        if np.all(kept[moving] >= keep * (1.0 - 1e-9)):
            return Shortened(samples=joined, sections=tuple(sections), kept=kept)
        wanted = 1.0 - _TIGHTEN * (1.0 - wanted)
    return Shortened(samples=record.copy(), sections=((0, record.shape[1]),), kept=np.where(moving, 1.0, np.nan))


def _windows_to_keep(shares: NDArray[np.float64], *, keep: float) -> list[int]:
    """Choose windows, rising, until each channel has its share; `shares` has shape (channels, windows).

    The gain of a window never grows while others are chosen, so a stored gain is an upper bound and only the first of
    the heap is computed again. Sums are exact (`fsum`): the order of the channels makes no difference.
    """
    columns = shares.T.tolist()
    missing = [keep] * shares.shape[0]

    def gain(window: int) -> float:
        return math.fsum(min(share, lack) for share, lack in zip(columns[window], missing, strict=True) if lack > 0.0)

    heap = [(-gain(window), window) for window in range(len(columns))]
    heapq.heapify(heap)
    chosen: list[int] = []
    while heap and any(lack > 1e-12 for lack in missing):
        _, window = heapq.heappop(heap)
        current = gain(window)
        if heap and (-current, window) > heap[0]:
            heapq.heappush(heap, (-current, window))
            continue
        if current == 0.0:
            break
        chosen.append(window)
        missing = [lack - share for lack, share in zip(missing, columns[window], strict=True)]
    return sorted(chosen)


def _runs(windows: list[int], *, edges: list[int]) -> list[tuple[int, int]]:
    """Return the sample ranges of windows, neighbours joined."""
    breaks = [i for i, (before, after) in enumerate(pairwise(windows), start=1) if after > before + 1]
    bounds = [0, *breaks, len(windows)]
    return [(edges[windows[first]], edges[windows[last - 1] + 1]) for first, last in pairwise(bounds)]


def _damage_kept(record: NDArray[np.float64], joined: NDArray[np.float64], *, exponent: float) -> NDArray[np.float64]:
    kept = np.full(record.shape[0], np.nan)
    for row, values in enumerate(record):
        if (unit := float(np.ptp(values))) > 0.0:
            after, before = (
                pseudo_damage(count_load_cycles(signal / unit), exponent) for signal in (joined[row], values)
            )
            kept[row] = after / before
    return kept
