"""Filters without a shift in time: Butterworth, run forward and backward."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record
from duralab_spectra.records import require_sample_rate

HIGHEST_FILTER_ORDER = 12
"""Highest order of a filter: beyond it, rounding errors merge the poles of a narrow filter."""

_SETTLED = 1e-3
"""Rest of a step at which the filter counts as settled."""


class FilterKind(Enum):
    """Kind of a filter."""

    LOW_PASS = "low_pass"
    HIGH_PASS = "high_pass"
    BAND_PASS = "band_pass"
    BAND_STOP = "band_stop"

    @property
    def corners(self) -> int:
        """Number of corner frequencies."""
        return 1 if self in (FilterKind.LOW_PASS, FilterKind.HIGH_PASS) else 2


def filter_zero_phase(
    samples: ArrayLike, *, sample_rate: float, kind: FilterKind, corners: Sequence[float], order: int = 4
) -> NDArray[np.float64]:
    """Filter every channel forward and backward.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit; 2 samples or more.
    sample_rate : float
        Sample rate in hertz.
    kind : FilterKind
        Kind of the filter.
    corners : sequence of float
        One frequency, or the lower and the upper of a band, in hertz, above 0 and below half the sample rate. At a
        corner the amplitude is halved (6 dB), as each pass reduces it by 3 dB.
    order : int
        Order of one pass, 1 to 12; a band has twice as many poles. The slope is that of twice the order.

    Returns
    -------
    ndarray, shape (channels, samples)
        Filtered record, as long as the record; beyond its ends the record is extended by odd reflection.

    Raises
    ------
    ValueError
        If the number of corners, a corner or the order is not allowed, or the record is no longer than the filter takes
        to settle.

    Notes
    -----
    Source: Butterworth (1930), digital by the bilinear transform with prewarped corners; the gain of both passes is
    `1 / (1 + r^(2 order))`, `r = tan(pi f / rate) / tan(pi corner / rate)` for a low-pass filter.
    """
    record = as_record(samples)
    require_sample_rate(sample_rate)
    frequencies = [float(corner) for corner in corners]
    if len(frequencies) != kind.corners:
        raise ValueError(f"A {kind.value} filter has {kind.corners} corners and was given {len(frequencies)}.")
    if not all(0.0 < corner < 0.5 * sample_rate for corner in frequencies):
        raise ValueError(
            f"The corners are {', '.join(f'{corner:g}' for corner in frequencies)} Hz; each must be above 0 and below "
            f"{0.5 * sample_rate:g} Hz, half the sample rate."
        )
    if len(frequencies) == 2 and frequencies[0] >= frequencies[1]:
        raise ValueError(f"The band goes from {frequencies[0]:g} to {frequencies[1]:g} Hz; the first must be lower.")
    if not 1 <= order <= HIGHEST_FILTER_ORDER:
        raise ValueError(f"The order is {order}; it must be 1 to {HIGHEST_FILTER_ORDER}.")
    if record.shape[1] < 2:
        raise ValueError("The record has one sample; a filter needs two at least.")
    # scipy.signal takes a second to import, and a service that only needs a record's damage must start at once.
    from scipy import signal

    sections = np.asarray(
        signal.butter(
            order,
            frequencies if len(frequencies) == 2 else frequencies[0],
            btype=kind.value.replace("_", ""),
            output="sos",
            fs=sample_rate,
        ),
        dtype=np.float64,
    )
    slowest = max(float(np.abs(np.roots(section[3:])).max()) for section in sections)
    settling = int(np.ceil(np.log(_SETTLED) / np.log(min(max(slowest, 0.5), 1.0 - 1e-9))))
    if settling >= record.shape[1]:
        raise ValueError(
            f"The filter takes {settling / sample_rate:.3g} s to settle and the record lasts "
            f"{record.shape[1] / sample_rate:.3g} s; it must be longer, so lower the order, move the corners away from "
            "0 Hz and from each other, or filter a longer record."
        )
    return np.ascontiguousarray(signal.sosfiltfilt(sections, record, axis=-1, padtype="odd", padlen=settling))
