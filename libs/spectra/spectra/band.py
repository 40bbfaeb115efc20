"""Frequency bands with smooth edges: as a mask of lines, and as a zero-phase filter of a record."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spectra.lines import line_frequencies
from spectra.records import as_record, require_sample_rate
from spectra.transforms import backward, fast_length, forward

# After this many times 1/edge the mask's impulse response has fallen by about 1e-7 of its peak.
_DECAY_EDGES = 16.0


def band_mask(frequency: ArrayLike, lowest: float, highest: float, *, edge: float) -> NDArray[np.float64]:
    """Mask that is 0 at and outside the limits of a band and 1 inside, with smooth edges inside the band.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz, 0 or more.
    lowest
        Lower limit, in hertz, 0 or more. At 0 there is no lower edge: the mask is 1 down to frequency 0.
    highest
        Upper limit, in hertz, above `lowest`.
    edge
        Width of each edge, in hertz, 0 or more, at most half the band. The edge rises as
        ``x - sin(2 pi x) / 2 pi``, whose first two derivatives vanish at both ends, so the impulse response dies out
        fast. At 0 the mask is 1 on the limits and 0 outside.

    Returns
    -------
    numpy.ndarray
        Shape (lines), 0 to 1.

    Raises
    ------
    ValueError
        Where the limits or the edge are not allowed.
    """
    if not (np.isfinite(lowest) and np.isfinite(highest) and 0.0 <= lowest < highest):
        raise ValueError(f"The band runs from {lowest} to {highest} Hz; it must be finite, rising and from 0 upward.")
    if not 0.0 <= edge <= (highest - lowest) / 2.0:
        raise ValueError(
            f"The band's edge is {edge} Hz wide; it must be 0 or more and at most half the band, "
            f"{(highest - lowest) / 2.0:.6g} Hz."
        )
    lines = np.asarray(frequency, dtype=np.float64)
    if edge == 0.0:
        return ((lines >= lowest) & (lines <= highest)).astype(np.float64)
    falling = _smooth_step((highest - lines) / edge)
    return falling if lowest == 0.0 else falling * _smooth_step((lines - lowest) / edge)


def limit_band(
    samples: ArrayLike, *, sample_rate: float, lowest: float, highest: float, edge: float
) -> NDArray[np.float64]:
    """Limit a record to a band without shifting its phase.

    Parameters
    ----------
    samples
        Shape (channels, samples), any length.
    sample_rate
        In hertz, greater than 0.
    lowest
        Lower limit, in hertz, 0 or more; at 0 the mean stays.
    highest
        Upper limit, in hertz, above `lowest` and at most half the sample rate.
    edge
        Width of each edge, in hertz, greater than 0 (a hard edge rings over the whole record), at most half the band.

    Returns
    -------
    numpy.ndarray
        Shape (channels, samples). The record is taken as zero before its start and after its end; it is padded until
        the mask's impulse response has died out, so its end does not return at its start.

    Raises
    ------
    ValueError
        Where the record, the sample rate or the band is not allowed.
    """
    record = as_record(samples)
    require_sample_rate(sample_rate)
    if edge <= 0.0:
        raise ValueError(f"The band's edge is {edge} Hz wide; filtering a record needs an edge greater than 0.")
    if highest > sample_rate / 2.0:
        raise ValueError(
            f"The band ends at {highest} Hz; at {sample_rate} samples per second it must end at or below "
            f"{sample_rate / 2.0} Hz."
        )
    count = record.shape[1]
    padded = fast_length(count + int(np.ceil(_DECAY_EDGES * sample_rate / edge)))
    mask = band_mask(line_frequencies(padded, sample_rate), lowest, highest, edge=edge)
    return np.ascontiguousarray(backward(forward(record, padded) * mask, padded)[:, :count])


def _smooth_step(position: NDArray[np.float64]) -> NDArray[np.float64]:
    inside = np.clip(position, 0.0, 1.0)
    return inside - np.sin(2.0 * np.pi * inside) / (2.0 * np.pi)
