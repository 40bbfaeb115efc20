"""Valid band of a model, and its values between its own lines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import line_frequencies


@dataclass(frozen=True)
class ValidBand:
    """Identified lines of a model, from the lowest to the highest.

    Parameters
    ----------
    lowest, highest
        Edges in hertz, both included.
    sample_rate
        Sample rate in hertz.
    block_samples
        Number of samples of the block with the model's lines.
    """

    lowest: float
    highest: float
    sample_rate: float
    block_samples: int

    @property
    def lines(self) -> NDArray[np.bool_]:
        """Mask of the model's lines in the band, shape (block_samples // 2 + 1)."""
        return self.contains(line_frequencies(self.block_samples, self.sample_rate))

    def contains(self, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each frequency is in the band.

        Parameters
        ----------
        frequency
            Shape (lines), in hertz.

        Returns
        -------
        numpy.ndarray
            Shape (lines), boolean.
        """
        return (frequency >= self.lowest) & (frequency <= self.highest)

    def between_lines(self, values: NDArray, frequency: NDArray[np.float64]) -> NDArray:
        """Interpolate values of the model's lines linearly to other frequencies.

        Parameters
        ----------
        values
            Shape (lines, ...), real or complex, at the model's lines.
        frequency
            Shape (new lines), in hertz, in the band. Between its edge and the first line within it that line's value is
            used.

        Returns
        -------
        numpy.ndarray
            Shape (new lines, ...).
        """
        held = np.flatnonzero(self.lines)
        position = np.clip(frequency * (self.block_samples / self.sample_rate), held[0], held[-1])
        below = np.minimum(position.astype(int), held[-1])
        above = np.minimum(below + 1, held[-1])
        share = (position - below).reshape(-1, *(1,) * (values.ndim - 1))
        return values[below] * (1.0 - share) + values[above] * share

    def curved_between_lines(
        self, frf: NDArray[np.complex128], frequency: NDArray[np.float64], *, laid: NDArray[np.bool_] | None = None
    ) -> NDArray[np.complex128]:
        """Interpolate an FRF to other frequencies by a cubic spline.

        Linear interpolation reduces the magnitude if the phase turns from line to line: for a response with a delay
        only the share ``sinc^2`` of the delay over the block would remain.

        Parameters
        ----------
        frf
            Complex, shape (lines, ...), at the model's lines.
        frequency
            Shape (new lines), in hertz, in the band. Between its edge and the first line within it that line's value is
            used: a cubic would extrapolate.
        laid
            Shape (lines): lines that were linearly interpolated, not estimated. The spline skips them, except for the
            first and the last line of the band. None: no such lines.

        Returns
        -------
        numpy.ndarray
            Complex, shape (new lines, ...).
        """
        held = np.flatnonzero(self.lines)
        if laid is not None:
            keep = ~laid[held]
            keep[[0, -1]] = True
            held = held[keep]
        position = np.clip(frequency * (self.block_samples / self.sample_rate), held[0], held[-1])
        if held.size == 1:
            return frf[np.full(position.size, held[0])]
        # The import takes half a second, and a service must start at once.
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(held, frf[held], axis=0)(position), dtype=np.complex128)
