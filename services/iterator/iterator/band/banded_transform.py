"""Transforms of records to the lines of a band and back, by a few short transforms instead of a long one.

A transform of `N` samples is the sum of the transforms of every `D`-th of them, each rotated by its start:
`X[k] = Σ_r wʳ X_r[k]` with `w = exp(-2πi k / N)`. If a band ends below half the rate of such a phase, the lines above
it are never computed, and the arrays of a transform are small enough to stay in the cache.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from scipy import fft

# A transform processes rows in pairs; more than four phases only add rotations.
_PHASES: Final = (4, 2, 1)


class BandedTransform:
    """Transforms records that are padded with zeros to one length; not safe for two threads at once.

    `length`: Number of samples of a record with its zeros; fastest as a multiple of four. `sample_rate`: Hz. `lowest`,
    `highest`: The band, Hz; at most half the sample rate. The line at `highest` is excluded.
    """

    def __init__(self, length: int, *, sample_rate: float, lowest: float, highest: float) -> None:
        spacing = sample_rate / length
        lines: NDArray[np.float64] = np.arange(length // 2 + 1, dtype=np.float64) * spacing
        start, stop = (int(line) for line in np.searchsorted(lines, (lowest, highest)))
        self.inside: Final = slice(start, stop)
        """Lines in the band, of all lines of a transform."""
        self.length: Final = length
        self._phases = next(phases for phases in _PHASES if _fit(phases, length=length, stop=stop))
        self._phase_length = length // self._phases
        self._turn = np.exp((-2j * np.pi / length) * np.arange(start, stop))
        self._turn_back = self._turn.conj()
        self._padded = np.zeros((self._phases, self._phase_length))
        self._whole = np.zeros((self._phases, self._phase_length // 2 + 1), dtype=np.complex128)
        self.frequency: NDArray[np.float64] = lines[self.inside]
        """Frequencies of the lines in the band, Hz: ndarray, shape (lines,)."""

    def lines(self, samples: NDArray[np.float64], *, weight: NDArray[np.float64], out: NDArray[np.complex128]) -> None:
        """Compute the weighted lines of one channel."""
        for phase, row in enumerate(self._padded):
            every = samples[phase :: self._phases]
            row[: every.size] = every
        of_phases = cast(NDArray[np.complex128], fft.rfft(self._padded, axis=1))[:, self.inside]
        out[:] = of_phases[-1]
        for of_phase in of_phases[-2::-1]:
            out *= self._turn
            out += of_phase
        out *= weight

    def samples(self, lines: NDArray[np.complex128], *, out: NDArray[np.float64]) -> None:
        """Compute the samples of one channel from its lines; lines outside the band are 0."""
        inside = self._whole[:, self.inside]
        np.multiply(lines, 1.0 / self._phases, out=inside[0])
        for before, phase in pairwise(inside):
            np.multiply(before, self._turn_back, out=phase)
        of_phases = cast(NDArray[np.float64], fft.irfft(self._whole, self._phase_length, axis=1))
        for phase, made in enumerate(of_phases):
            every = out[phase :: self._phases]
            every[:] = made[: every.size]


def _fit(phases: int, *, length: int, stop: int) -> bool:
    """Return whether the band's lines are below half the rate of each phase."""
    return phases == 1 or (length % phases == 0 and 2 * (stop - 1) < length // phases)
