"""Resampling of a record to another sample rate."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record
from duralab_spectra.records import require_sample_rate

FLAT_SHARE = 0.87
"""Share of half the lower sample rate up to which amplitudes are kept; from 1 on nothing passes."""

LARGEST_FACTOR = 2000
"""Largest numerator or denominator of the ratio of the rates: the filter is 128 times as long."""

_HALF_LENGTH = 64
"""Number of samples of the lower rate on either side of the filter's centre."""

_KAISER_BETA = 12.3
"""Kaiser parameter for 120 dB of stop band (Kaiser's formula); the transition is 0.13 of half the lower rate."""

_LARGEST_RATE_ERROR = 1e-6
"""Largest relative error of the ratio of the rates, from the rounding of a file's time step: 4 ms in an hour."""


def resample(samples: ArrayLike, *, sample_rate: float, new_rate: float) -> NDArray[np.float64]:
    """Return the same signals at another sample rate; the first sample stays at its time.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    sample_rate, new_rate : float
        Sample rates in hertz; their ratio must be one of whole numbers up to 2000.

    Returns
    -------
    ndarray, shape (channels, ceil(samples new_rate / sample_rate))
        Resampled record. Content below 0.87 of half the lower rate is kept to 1e-6; content above half the new rate is
        removed, not folded. Beyond its ends the record is extended by odd reflection, so the last 64 samples of the
        lower rate at either end are less exact.

    Raises
    ------
    ValueError
        If a rate is not above 0, or the ratio needs larger numbers.

    Notes
    -----
    Source: Crochiere and Rabiner, *Multirate Digital Signal Processing* (1983), polyphase; window of Kaiser (1974).
    """
    record = as_record(samples)
    require_sample_rate(sample_rate)
    require_sample_rate(new_rate)
    ratio = Fraction(new_rate / sample_rate).limit_denominator(LARGEST_FACTOR)
    off = abs(float(ratio) * sample_rate / new_rate - 1.0)
    if ratio.numerator > LARGEST_FACTOR or ratio.numerator == 0 or off > _LARGEST_RATE_ERROR:
        raise ValueError(
            f"From {sample_rate:.9g} to {new_rate:.9g} Hz is no ratio of whole numbers up to {LARGEST_FACTOR}; take a "
            "rate that is, or resample in two steps."
        )
    up, down = ratio.numerator, ratio.denominator
    if up == down or record.shape[1] == 1:
        return record.copy()
    slower = max(up, down)
    half = _HALF_LENGTH * slower
    # An ideal low-pass filter between the edges of the transition, with Kaiser's window; gain 1 at 0 Hz.
    cutoff = 0.5 * (FLAT_SHARE + 1.0) / slower
    kernel = np.sinc(cutoff * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, _KAISER_BETA)
    kernel /= kernel.sum()
    # A whole number of input periods in front, so that the first sample of the result is again the record's first.
    extension = (half // up // down + 2) * down
    extended = np.pad(record, ((0, 0), (extension, extension)), mode="reflect", reflect_type="odd")
    # scipy.signal takes a second to import, and a service that only needs a record's damage must start at once.
    from scipy.signal import resample_poly

    resampled = np.asarray(resample_poly(extended, up, down, axis=-1, window=kernel))
    first, length = extension // down * up, -(-record.shape[1] * up // down)
    return np.ascontiguousarray(resampled[:, first : first + length])
