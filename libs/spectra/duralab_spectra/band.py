"""Frequency bands with smooth edges, as a mask of lines."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def band_mask(frequency: ArrayLike, lowest: float, highest: float, *, edge: float) -> NDArray[np.float64]:
    """Return a mask that is 0 at and outside the limits of a band and 1 inside, with smooth edges inside the band.

    Parameters
    ----------
    frequency
        Frequencies of the lines, shape (lines), in hertz, 0 or more.
    lowest
        Lower limit, in hertz, 0 or more. At 0 there is no lower edge: the mask is 1 down to frequency 0.
    highest
        Upper limit, in hertz, above `lowest`.
    edge
        Width of each edge, in hertz, 0 or more, at most half the band. The edge rises as ``x - sin(2 pi x) / 2 pi``,
        whose first two derivatives vanish at both ends, so the impulse response decays fast. At 0 the mask is 1 on the
        limits and 0 outside.

    Returns
    -------
    numpy.ndarray
        Mask, shape (lines), 0 to 1.

    Raises
    ------
    ValueError
        If the limits or the edge are not allowed.
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


def _smooth_step(position: NDArray[np.float64]) -> NDArray[np.float64]:
    inside = np.clip(position, 0.0, 1.0)
    return inside - np.sin(2.0 * np.pi * inside) / (2.0 * np.pi)
