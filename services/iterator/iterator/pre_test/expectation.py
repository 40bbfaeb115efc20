"""Expected responses of a pre-test: from the model of an identification, or from an earlier pre-test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.model import InterpolatedMatrix
from iterator.pre_test.pulses import PulseTrain

_SMOOTHING_SECONDS: Final = 0.02
# Length of a model's prediction, in windows.
_LONGER: Final = 8


@dataclass(frozen=True)
class KnownFrf:
    """The FRF of an identified rig: frequency (lines,) in Hz, FRF (lines, responses, drives), and its valid band."""

    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    band: tuple[float, float]


@dataclass(frozen=True)
class Expectation:
    """Expected responses in the window of each drive, shape (responses, drives, samples), as `within` returns them.

    `band`: Band in Hz of the comparison; None: all frequencies.
    """

    response: NDArray[np.float64]
    band: tuple[float, float] | None = None


def expected_of_model(known: KnownFrf, train: PulseTrain, sample_rate: float) -> Expectation | None:
    """Return the response of a model to pulses, in the model's band; None if it has fewer than four lines there."""
    lowest, highest = known.band
    inside = (known.frequency >= lowest) & (known.frequency <= highest) & np.isfinite(known.frf).all(axis=(1, 2))
    lines = known.frequency[inside]
    if lines.size < 4:
        return None
    band = float(lines[0]), float(lines[-1])
    pulses = np.diagonal(in_windows(train.drive, train)).T
    drives, samples = pulses.shape
    # Long enough that ringing does not wrap around; responses before the window are at the end.
    length = _LONGER * samples
    frequency, weight = _weights(band, length, sample_rate)
    wanted = weight > 0.0
    matrix = InterpolatedMatrix(lines, known.frf[inside], at=frequency[wanted])
    spectrum = np.zeros((drives, drives, np.count_nonzero(wanted)), dtype=np.complex128)
    spectrum[np.arange(drives), np.arange(drives)] = (weight * np.fft.rfft(pulses, length))[:, wanted]
    out = np.zeros((known.frf.shape[1], drives, frequency.size), dtype=np.complex128)
    for column in range(drives):
        out[:, column, wanted] = matrix.times(spectrum[column])
    return Expectation(_in_the_window(np.fft.irfft(out, length), samples), band)


def in_windows(record: NDArray[np.float64], train: PulseTrain) -> NDArray[np.float64]:
    """Return the parts of a record (channels, samples) in the window of each drive: (channels, drives, samples).

    Each is relative to its level before the window, because friction keeps a specimen from its earlier position.
    """
    # The last quarter is left out because it contains early effects of filters and smoothing.
    before = [slice(window.start - train.guard, window.start - train.guard // 4) for window in train.windows]
    return np.stack(
        [
            record[:, window] - record[:, level].mean(axis=1, keepdims=True)
            for window, level in zip(train.windows, before, strict=True)
        ],
        axis=1,
    )


def within(band: tuple[float, float] | None, parts: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """Return records (…, samples) in a band in Hz, at twice their length: the end holds the part before the window."""
    if band is None:
        return np.concatenate([parts, np.zeros_like(parts)], axis=-1)
    samples = parts.shape[-1]
    _, weight = _weights(band, 2 * samples, sample_rate)
    return _in_the_window(np.fft.irfft(weight * np.fft.rfft(parts, 2 * samples), 2 * samples), samples)


def _in_the_window(periodic: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Return the part of periodic records (…, samples) in a window that begins with them, or shortly before it."""
    before = samples // 4
    nothing = np.zeros((*periodic.shape[:-1], samples - before))
    return np.concatenate([periodic[..., :samples], nothing, periodic[..., -before:]], axis=-1)


def smoothed(records: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """Return records (…, samples) smoothed by a short window, which passes the pulses but not most white noise."""
    half = max(round(_SMOOTHING_SECONDS * sample_rate) // 2, 1)
    window = np.hanning(2 * half + 3)[1:-1]
    rows = np.pad(records.reshape(-1, records.shape[-1]), ((0, 0), (half, half)), mode="edge")
    return np.stack([np.convolve(row, window / window.sum(), mode="valid") for row in rows]).reshape(records.shape)


def _weights(
    band: tuple[float, float], length: int, sample_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lines of a transform in Hz, and the weight of each, with faded edges to avoid ringing."""
    frequency = np.fft.rfftfreq(length, 1.0 / sample_rate).astype(np.float64)
    lowest, highest = band
    # Fade from the lower edge to three times it, and over the upper fifth.
    rise = np.clip((frequency - lowest) / (2.0 * lowest), 0.0, 1.0) if lowest > 0.0 else np.ones_like(frequency)
    fall = np.clip((highest - frequency) / (0.2 * highest), 0.0, 1.0)
    return frequency, np.sin(0.5 * np.pi * rise) ** 2 * np.sin(0.5 * np.pi * fall) ** 2
