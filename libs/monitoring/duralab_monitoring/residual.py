"""Residual of a response against an event's mean response: aligned in time, in bands, as a share of the RMS.

In each band the residual has a part along the mean response (gain), a part shifted by a quarter of a period (phase),
and a remainder. Gain and phase have a sign, so that small changes add up over repeats; they are linear in the response,
so Gaussian noise leaves them Gaussian. The cube root of the remainder's energy is nearly Gaussian, too (Wilson and
Hilferty, 1931).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
import scipy  # imports scipy.fft on first use, which takes 0.2 s
from numpy.typing import NDArray

_LARGEST_LAG_SECONDS = 0.1
_NEWTON_STEPS = 4


class Measure(StrEnum):
    """Kind of change of a response."""

    STATIC = "static"
    """Change of its static part."""
    GAIN = "gain"
    """Change of its amplitude, in phase with the baseline."""
    PHASE = "phase"
    """Change of its phase against the baseline."""
    REMAINDER = "remainder"
    """Part that neither gain nor phase explains."""


@dataclass(frozen=True)
class BandLines:
    """Lines of the spectrum of a record of `samples` samples, from the lowest edge to the highest.

    `omega`, shape (lines,): rad/s. `starts`, shape (bands,): First line of each band, counted from the first of all.
    """

    samples: int
    sample_rate: float
    first: int
    last: int
    starts: NDArray[np.intp]

    @classmethod
    def of(cls, edges: tuple[float, ...], *, samples: int, sample_rate: float) -> BandLines:
        """Return the lines of the bands; raise ValueError for a record too short for two in each band."""
        placed = np.ceil(np.array(edges) * samples / sample_rate - 1e-9).astype(np.intp)
        for (low, high), (first, end) in zip(pairwise(edges), pairwise(placed), strict=True):
            if end - first < 2:
                raise ValueError(
                    f"The record lasts {samples / sample_rate:g} s, so the band from {low:g} to {high:g} Hz has "
                    f"{max(0, end - first)} lines; it needs 2: give wider bands or a longer event."
                )
        return cls(samples, sample_rate, int(placed[0]), int(placed[-1]), placed[:-1] - placed[0])

    @property
    def omega(self) -> NDArray[np.float64]:
        """Circular frequency of each line, rad/s."""
        return np.arange(self.first, self.last, dtype=np.float64) * (2.0 * np.pi * self.sample_rate / self.samples)

    def spectrum(self, record: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the lines of a record, so that half the square of a magnitude is the power of a line."""
        return np.asarray(scipy.fft.rfft(record, axis=1), dtype=np.complex128)[:, self.first : self.last] * (
            2.0 / self.samples
        )

    def lag(self, reference: NDArray[np.complex128], lines: NDArray[np.complex128]) -> float:
        """Return the delay in s of one record against another, at which they correlate most over all rows."""
        weight = 1.0 / np.maximum(np.sum(np.abs(reference) ** 2, axis=1), np.finfo(float).tiny)
        cross = weight @ (reference.conj() * lines)
        if not cross.any():
            return 0.0
        whole = np.zeros(self.samples // 2 + 1, dtype=np.complex128)
        whole[self.first : self.last] = cross
        reach = min(round(_LARGEST_LAG_SECONDS * self.sample_rate), self.samples // 2 - 1)
        places = np.arange(-reach, reach + 1)
        lag = float(places[np.argmax(np.asarray(scipy.fft.irfft(whole, n=self.samples))[places])]) / self.sample_rate
        omega = self.omega
        for _ in range(_NEWTON_STEPS):
            turned = cross * np.exp(1j * omega * lag)
            curvature = float(omega**2 @ turned.real)
            if curvature <= 0.0:
                break
            lag -= float(omega @ turned.imag) / curvature
        return lag


@dataclass
class Reference:
    """Mean of an event's first repeats, aligned to the first; extended by `add`.

    `lines`, shape (rows, lines): Spectra of the responses, then of the recorded commands. `mean` and `power`, shape
    (channels,): Static part, and mean square beside it, of the responses.
    """

    bands: BandLines
    commands: int
    repeats: int
    lines: NDArray[np.complex128]
    mean: NDArray[np.float64]
    power: NDArray[np.float64]

    @classmethod
    def empty(cls, bands: BandLines, *, channels: int, commands: int) -> Reference:
        """Return an empty reference."""
        lines = np.zeros((channels + commands, bands.last - bands.first), dtype=np.complex128)
        return cls(bands, commands, 0, lines, np.zeros(channels), np.zeros(channels))

    def add(self, record: NDArray[np.float64]) -> None:
        """Add a repeat: responses, then commands."""
        aligned, _ = self._aligned(record)
        channels = self.mean.size
        self.repeats += 1
        self.lines += (aligned - self.lines) / self.repeats
        self.mean += (record[:channels].mean(axis=1) - self.mean) / self.repeats
        self.power += (record[:channels].var(axis=1) - self.power) / self.repeats

    @property
    def unit(self) -> NDArray[np.float64]:
        """RMS of each channel beside its static part, shape (channels,); 1 for a constant channel."""
        return np.where(self.power > 0.0, np.sqrt(self.power), 1.0)

    def measures(self, record: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return the measures (channels, 1 + 3 bands) as shares of the RMS, and the lag in s.

        Their columns are static part, gain of each band, phase of each band, and the cube root of the remainder's
        energy.
        """
        aligned, lag = self._aligned(record)
        channels = self.mean.size
        unit = self.unit[:, None]
        reference, starts = self.lines[:channels], self.bands.starts
        scale = np.sqrt(0.5) / unit
        difference = (aligned[:channels] - reference) * scale

        def total(lines: NDArray[np.complex128] | NDArray[np.float64]) -> NDArray[np.complex128]:
            return np.add.reduceat(lines, starts, axis=1)

        length = np.sqrt(total(np.abs(reference) ** 2).real)
        along = total(reference.conj() * difference) / np.where(length > 0.0, length, 1.0)
        energy = total(np.abs(difference) ** 2).real
        remainder = np.cbrt(np.maximum(energy - np.abs(along) ** 2, 0.0))
        static = (record[:channels].mean(axis=1) - self.mean)[:, None] / unit
        return np.concatenate([static, along.real, along.imag, remainder], axis=1), lag

    def _aligned(self, record: NDArray[np.float64]) -> tuple[NDArray[np.complex128], float]:
        lines = self.bands.spectrum(record)
        if self.repeats == 0:
            return lines, 0.0
        # Recorded commands show the lag of the recording only; a worn specimen delays its responses, too.
        rows = slice(self.mean.size, None) if self.commands else slice(None)
        lag = self.bands.lag(self.lines[rows], lines[rows])
        return lines * np.exp(1j * self.bands.omega * lag), lag
