"""Spikes: single samples, or a few, that the measuring chain and not the vehicle put into a load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record

_NORMAL_MEDIAN = 0.6745
"""Median magnitude of a normal variable, in its standard deviation."""

_WINDOW = 10
"""Number of samples beside a spike that define the usual level there, in lengths of the longest spike."""

_FOOT = 0.1
"""Share of its height down to which a spike extends."""


@dataclass(frozen=True)
class Despiked:
    """Record without its spikes.

    Parameters
    ----------
    samples : ndarray, shape (channels, samples)
        Record, interpolated at each spike.
    spikes : tuple of int, one for each channel
        Number of spikes found.
    largest : tuple of float, one for each channel
        Height of the largest spike, in the channel's unit; 0 if there is none.
    """

    samples: NDArray[np.float64]
    spikes: tuple[int, ...]
    largest: tuple[float, ...]


def remove_spikes(samples: ArrayLike, *, longest: int, threshold: float = 10.0) -> Despiked:
    """Find the spikes of every channel and replace each by a smooth curve.

    A spike exceeds the samples on both sides, is no longer than `longest` at half its height, and is higher than
    `threshold` times the usual level around it. A smooth peak of any height is wider (1.4 times the compared
    distance), a step returns on one side only, and an impact rings: all three are kept. A ringing above 100 Hz that
    has decayed after two periods looks like a spike of its length.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    longest : int
        Length of the longest spike in samples, 1 or more.
    threshold : float
        Height of the lowest spike, in standard deviations of the signal without spikes, greater than 0.

    Returns
    -------
    Despiked
        Despiked record; a spike at the very first or last sample is not found.

    Raises
    ------
    ValueError
        If a length or threshold is not allowed, or the record is too short to define a usual level.
    """
    record = as_record(samples)
    if longest < 1:
        raise ValueError(f"The longest spike is {longest} samples; it must be 1 or more.")
    if not (np.isfinite(threshold) and threshold > 0.0):
        raise ValueError(f"The threshold is {threshold:g}; it must be finite and greater than 0.")
    needed = 4 * (_WINDOW * longest + longest + 1)
    if record.shape[1] < needed:
        raise ValueError(
            f"The record has {record.shape[1]} samples; {needed} are needed to know a spike of {longest} from a load."
        )
    result = record.copy()
    found: list[list[tuple[int, int, float]]] = []
    for row, values in enumerate(record):
        spikes = _find(values, longest=longest, threshold=threshold)
        found.append(spikes)
        if spikes:
            good = np.ones(values.size, dtype=bool)
            for start, end, _ in spikes:
                good[start:end] = False
            # The import takes half a second, and a service that repairs no record must start at once.
            from scipy.interpolate import PchipInterpolator

            time = np.arange(values.size, dtype=np.float64)
            result[row, ~good] = PchipInterpolator(time[good], values[good])(time[~good])
    return Despiked(
        samples=result,
        spikes=tuple(len(spikes) for spikes in found),
        largest=tuple(max((height for _, _, height in spikes), default=0.0) for spikes in found),
    )


def _find(values: NDArray[np.float64], *, longest: int, threshold: float) -> list[tuple[int, int, float]]:
    """Return first sample, the one after the last, and height of each spike."""
    reach = longest + 1
    padded = np.pad(values, reach, mode="edge")
    before, after = values - padded[: -2 * reach], values - padded[2 * reach :]
    # Higher than both sides, or lower than both: the smaller of the two differences; otherwise 0.
    height = np.where(before * after > 0.0, np.sign(before) * np.minimum(np.abs(before), np.abs(after)), 0.0)
    usual = _usual(0.5 * np.abs(before + after), longest=longest)
    candidates = np.flatnonzero(np.abs(height) > threshold * usual)
    spikes: list[tuple[int, int, float]] = []
    for group in np.split(candidates, np.flatnonzero(np.diff(candidates) > reach) + 1) if candidates.size else []:
        peak = int(group[np.argmax(np.abs(height[group]))])
        tall, base = abs(float(height[peak])), values[peak] - height[peak]
        above = np.sign(height[peak]) * (values - base)[max(0, peak - reach) : peak + reach + 1]
        centre = peak - max(0, peak - reach)
        first, last = _run(above > 0.5 * tall, centre)
        if last - first > longest:
            continue
        first, last = _run(above > _FOOT * tall, centre)
        start = max(0, peak - reach)
        spikes.append((start + max(first, centre - longest), start + min(last, centre + longest + 1), tall))
    return spikes


def _usual(curvature: NDArray[np.float64], *, longest: int) -> NDArray[np.float64]:
    """Return the standard deviation of the curvature around each sample, or on its livelier side if that is larger.

    On the livelier side, because a load that begins is quiet before its first peak; and never less than the value over
    the moving parts of the record, because rest is no measure for spikes. A spike fills less than half of a window.
    """
    from scipy.ndimage import median_filter

    window = _WINDOW * longest + 1
    around = median_filter(curvature, size=window, mode="nearest")
    aside = window // 2 + 2 * (longest + 1)
    padded = np.pad(around, aside, mode="edge")
    beside = np.maximum(padded[: -2 * aside], padded[2 * aside :])
    moving = curvature[curvature > 0.0]
    everywhere = float(np.median(moving)) if moving.size > 0.5 * curvature.size else 0.0
    return np.maximum(np.maximum(around, beside), everywhere) / _NORMAL_MEDIAN


def _run(marked: NDArray[np.bool_], centre: int) -> tuple[int, int]:
    """Return the first sample of the marked run around a marked sample, and the sample after its end."""
    before, after = np.flatnonzero(~marked[:centre]), np.flatnonzero(~marked[centre:])
    return int(before[-1]) + 1 if before.size else 0, centre + (int(after[0]) if after.size else marked.size - centre)
