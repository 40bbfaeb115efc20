"""The control band: where the target is prepared, responses are judged and drives are made."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from iterator.banded_transform import BandedTransform
from spectra import band_mask, dynamic_part, static_levels

# Shares of the band's own edges that the smooth flanks take.
_LOWER_FLANK_SHARE = 0.25
_UPPER_FLANK_SHARE = 0.05
# Zeros behind a record, in periods of the narrower flank: a flank's ringing has died out by then.
_PADDING_PERIODS = 16.0


@dataclass(frozen=True)
class ControlBand:
    """Band in which a campaign reproduces and judges, with two nested masks that have smooth flanks.

    The *drive mask* rises from 0 at `lowest` to 1 one flank further in; drives and judged responses pass it.
    The *target mask* rises in the flank after that. Where the target has energy the drive mask is therefore exactly 1,
    and the error of a linear plant with an exact model shrinks by exactly `1 - q` at every line; with one mask for
    both, the lines of its flanks would lag behind for ever.

    Parameters
    ----------
    lowest, highest : float
        Edges, Hz; `0 < lowest < highest <= sample_rate / 2`.
    sample_rate : float
        Of all records, Hz.
    lower_flank, upper_flank : float
        Width of one flank at either edge, Hz, greater than 0. See `control_band` for the usual ones.

    Raises
    ------
    ValueError
        The edges are not in order, a flank is not above 0, or the band is too narrow for its flanks.
    """

    lowest: float
    highest: float
    sample_rate: float
    lower_flank: float
    upper_flank: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sample_rate) and self.sample_rate > 0.0):
            raise ValueError(f"The sample rate is {self.sample_rate} Hz; it must be greater than 0.")
        if not 0.0 < self.lowest < self.highest <= self.sample_rate / 2.0:
            raise ValueError(
                f"The control band is {self.lowest:g} to {self.highest:g} Hz; it must lie above 0 and up to half the "
                f"sample rate, {self.sample_rate / 2.0:g} Hz."
            )
        if not (0.0 < self.lower_flank <= self.lowest and self.upper_flank > 0.0):
            raise ValueError(
                f"The flanks of the control band are {self.lower_flank:g} and {self.upper_flank:g} Hz wide; both must "
                f"be greater than 0 and the lower at most the band's lower edge, {self.lowest:g} Hz."
            )
        if self.lowest + 2.0 * self.lower_flank >= self.highest - 2.0 * self.upper_flank:
            raise ValueError(
                f"The control band of {self.lowest:g} to {self.highest:g} Hz is too narrow for its flanks; two of "
                f"{self.lower_flank:g} Hz and two of {self.upper_flank:g} Hz must fit into it."
            )

    def drive_mask(self, frequency: np.ndarray) -> NDArray[np.float64]:
        """Weight of each line for drives and judged responses.

        Parameters
        ----------
        frequency : ndarray, shape (lines,)
            Hz.

        Returns
        -------
        ndarray, shape (lines,)
            0 to 1.
        """
        return _mask(
            frequency,
            lowest=self.lowest,
            highest=self.highest,
            lower_flank=self.lower_flank,
            upper_flank=self.upper_flank,
        )

    def target_mask(self, frequency: np.ndarray) -> NDArray[np.float64]:
        """Weight of each line for the target; `drive_mask` is 1 wherever this is greater than 0.

        Parameters
        ----------
        frequency : ndarray, shape (lines,)
            Hz.

        Returns
        -------
        ndarray, shape (lines,)
            0 to 1.
        """
        return _mask(
            frequency,
            lowest=self.lowest + self.lower_flank,
            highest=self.highest - self.upper_flank,
            lower_flank=self.lower_flank,
            upper_flank=self.upper_flank,
        )

    @property
    def ringing_samples(self) -> int:
        """Number of zeros in which what rings at the narrower flank has died out."""
        return math.ceil(_PADDING_PERIODS * self.sample_rate / min(self.lower_flank, self.upper_flank))

    def transform_samples(self, samples: int) -> int:
        """Length of a transform in which a record of so many samples is filtered without wrap-around.

        Parameters
        ----------
        samples : int
            Length of the record, 1 or more.

        Returns
        -------
        int
            A multiple of four: the record, and zeros for what rings before its start and after its end.
        """
        quarter = math.ceil((samples + max(samples, self.ringing_samples)) / 4)
        return 4 * cast(int, next_fast_len(quarter, real=True))

    def transform(self, samples: int) -> BandedTransform:
        """Transform of records of so many samples, to the lines of the band and back, without wrap-around.

        Parameters
        ----------
        samples : int
            Length of a record, 1 or more.

        Returns
        -------
        BandedTransform
            For one thread.
        """
        return BandedTransform(
            self.transform_samples(samples), sample_rate=self.sample_rate, lowest=self.lowest, highest=self.highest
        )

    def limit_target(self, target: np.ndarray) -> NDArray[np.float64]:
        """Prepare the target: its dynamic part in the control band, without delay.

        Parameters
        ----------
        target : ndarray, shape (channels, samples)
            As measured; the static part, between its levels at start and end, is left out.

        Returns
        -------
        ndarray, shape (channels, samples)
            In the target's units.
        """
        return self._limit(target, self.target_mask)

    def limit_response(self, response: np.ndarray) -> NDArray[np.float64]:
        """Return a response's dynamic part as it is judged: in the control band, without delay.

        Parameters
        ----------
        response : ndarray, shape (channels, samples)
            As measured; the static part, between its levels at start and end, is left out.

        Returns
        -------
        ndarray, shape (channels, samples)
            In the response's units.
        """
        return self._limit(response, self.drive_mask)

    def dynamic_part(self, samples: np.ndarray) -> NDArray[np.float64]:
        """Return a record without its static part, not limited to the band.

        Parameters
        ----------
        samples : ndarray, shape (channels, samples)
            As measured; the static part is between its levels at start and end.

        Returns
        -------
        ndarray, shape (channels, samples)
            In the record's units.
        """
        return dynamic_part(samples, lowest=self.lowest, sample_rate=self.sample_rate)

    def _limit(self, samples: np.ndarray, mask: Callable[[np.ndarray], NDArray[np.float64]]) -> NDArray[np.float64]:
        limited = self.dynamic_part(samples)
        transform = self.transform(limited.shape[1])
        weight = mask(transform.frequency)
        lines = np.empty(weight.size, dtype=np.complex128)
        for row in limited:
            transform.lines(row, weight=weight, out=lines)
            transform.samples(lines, out=row)
        return limited

    def static_levels(self, samples: np.ndarray) -> NDArray[np.float64]:
        """Return the levels at start and end between which a record's static part lies.

        Parameters
        ----------
        samples : ndarray, shape (channels, samples)
            As measured.

        Returns
        -------
        ndarray, shape (channels, 2)
            In the record's units.
        """
        return static_levels(samples, lowest=self.lowest, sample_rate=self.sample_rate)


def control_band(lowest: float, highest: float, *, sample_rate: float) -> ControlBand:
    """Control band with the usual flanks: a quarter of its lower edge, a twentieth of its upper one.

    Parameters
    ----------
    lowest, highest : float
        Edges, Hz; `0 < lowest < highest <= sample_rate / 2`.
    sample_rate : float
        Of all records, Hz.

    Returns
    -------
    ControlBand
        Target complete from `1.5 lowest` to `0.9 highest`.

    Raises
    ------
    ValueError
        Edges out of range, or too close together for the flanks.
    """
    return ControlBand(
        lowest=lowest,
        highest=highest,
        sample_rate=sample_rate,
        lower_flank=_LOWER_FLANK_SHARE * lowest,
        upper_flank=_UPPER_FLANK_SHARE * highest,
    )


def _mask(
    frequency: np.ndarray, *, lowest: float, highest: float, lower_flank: float, upper_flank: float
) -> NDArray[np.float64]:
    # spectra's mask has edges of one width; a lower edge is what a mask with an upper edge only leaves.
    below = band_mask(frequency, 0.0, lowest + lower_flank, edge=lower_flank)
    return (1.0 - below) * band_mask(frequency, 0.0, highest, edge=upper_flank)
