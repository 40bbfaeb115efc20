"""Band-limited interpolation of a record, at another rate or at any instants, by a windowed sinc."""

from __future__ import annotations

import numpy as np

_ZERO_CROSSINGS = 48
_KAISER_BETA = 9.0
#: Share of half the lower rate up to which nothing is attenuated; the slope of the window is above it.
PASSED = 0.9
_CHUNK = 20_000
#: Decimals of a place between two samples: far below what 16 bits tell apart, far above rounding.
_PLACE_DECIMALS = 9


def sampled_at(samples: np.ndarray, rate: float, instants: np.ndarray, *, new_rate: float) -> np.ndarray:
    """Resample a record; components above half the lower of both rates are removed.

    Parameters
    ----------
    samples : ndarray, shape (channels, samples)
        Record; beyond its ends it keeps its first and last values.
    rate : float
        Sample rate of the record, in Hz.
    instants : ndarray, shape (instants,)
        Times in s from its first sample, 1 / `new_rate` apart.
    new_rate : float
        New sample rate in Hz.

    Returns
    -------
    ndarray, shape (channels, instants)
        Resampled record, in the same units.
    """
    scale = min(1.0, new_rate / rate)
    half = int(np.ceil(_ZERO_CROSSINGS / scale))
    padded = np.pad(samples, ((0, 0), (half, half + 1)), mode="edge")
    places = np.clip(np.asarray(instants) * rate, -half + 1.0, samples.shape[1] - 2.0 + half)
    out = np.empty((len(samples), len(places)))
    taps = np.arange(-half + 1, half + 1)
    for begin in range(0, len(places), _CHUNK):
        piece = places[begin : begin + _CHUNK]
        whole = np.floor(piece).astype(np.int64)
        # At usual rates only a few places between two samples occur: their weights are computed once.
        between, recurring = np.unique(np.round(piece - whole, _PLACE_DECIMALS), return_inverse=True)
        distance = taps[None, :] - between[:, None]
        shape = np.sqrt(np.clip(1.0 - (distance / half) ** 2, 0.0, None))
        weight = scale * np.sinc(scale * distance) * np.i0(_KAISER_BETA * shape) / np.i0(_KAISER_BETA)
        # A constant is not changed.
        weight /= weight.sum(axis=1, keepdims=True)
        weight = weight[recurring]
        rows = np.clip(whole[:, None] + taps[None, :] + half, 0, padded.shape[1] - 1)
        for channel, line in enumerate(padded):
            out[channel, begin : begin + _CHUNK] = np.einsum("ij,ij->i", weight, line[rows])
    return out


def resampled(samples: np.ndarray, rate: float, new_rate: float) -> np.ndarray:
    """Return a record at another rate.

    Parameters
    ----------
    samples : ndarray, shape (channels, samples)
        Record at `rate`.
    rate, new_rate : float
        Sample rates in Hz.

    Returns
    -------
    ndarray, shape (channels, new samples)
        Record from the same first instant to nearly the same last.
    """
    if rate == new_rate:
        return samples
    count = int(np.floor((samples.shape[1] - 1) * new_rate / rate + 1.0e-9)) + 1
    return sampled_at(samples, rate, np.arange(count) / new_rate, new_rate=new_rate)
