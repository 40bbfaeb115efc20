"""Control band, in which the target is prepared, responses are judged and drives are made."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from duralab_spectra import as_record, band_mask, dynamic_part, static_levels
from iterator.band.banded_transform import BandedTransform
from iterator.band.rest import TARGET_FADE_SECONDS, faded

# Usual widths of the flanks outside the band, as shares of its edges.
_LOWER_FLANK_SHARE: Final = 0.5
_UPPER_FLANK_SHARE: Final = 0.1
# If the excited band leaves less room than the usual flank, the flank takes the room, down to this share of itself.
_NARROWEST_SHARE: Final = 0.25
# Room and flank are differences of edges, and are rounded.
_ROUNDING: Final = 1e-9
# Zeros after a record, in periods of the narrower flank, in which a flank's ringing decays to 3e-6 of its peak or less.
# With 16 periods, transforms for a target of 40 s in a band from 0.5 Hz were four times as long as the target.
_PADDING_PERIODS: Final = 5.0
# Share of the sample rate. A narrower flank rings for more samples than any target has; half the smallest float is 0.
_NARROWEST_FLANK: Final = 1e-9


@dataclass(frozen=True)
class ControlBand:
    """Band in which a campaign reproduces and judges, with two nested masks whose smooth flanks lie outside it.

    Both masks are 1 from `lowest` to `highest`: the target is whole in the band. In the half of a flank next to the
    band the *target mask* falls to 0, in the other half the *drive mask*, which limits drives and judged responses.
    Where the target has energy the drive mask is therefore exactly 1, and the error of a linear plant with an exact
    model shrinks by exactly `1 - q` at every line; with one mask for both, the lines of its flanks would never follow.

    A band from 0 Hz has no lower flank: means and slow parts are in the band, too. Records are then relative to the
    rig's static response, not to the line between their own levels at start and end.

    Parameters
    ----------
    lowest, highest : float
        Edges, Hz; `0 <= lowest < highest < sample_rate / 2`.
    sample_rate : float
        Sample rate of all records, Hz.
    lower_flank, upper_flank : float
        Width of the flank below `lowest` and of the one above `highest`, Hz, greater than 0, but 0 below a band from 0
        Hz; they end at 0 Hz or above and at half the sample rate or below. See `control_band` for the usual ones.
    static_response : tuple of float, optional
        Level of each channel of a record at drive 0, response units; given only if `lowest` is 0.

    Raises
    ------
    ValueError
        The edges are not in order, or a flank is not above 0 or has no room.
    """

    lowest: float
    highest: float
    sample_rate: float
    lower_flank: float
    upper_flank: float
    static_response: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sample_rate) and self.sample_rate > 0.0):
            raise ValueError(f"The sample rate is {self.sample_rate} Hz; it must be greater than 0.")
        if not 0.0 <= self.lowest < self.highest <= self.sample_rate / 2.0:
            raise ValueError(
                f"The control band is {self.lowest:g} to {self.highest:g} Hz; it must lie from 0 up to half the "
                f"sample rate, {self.sample_rate / 2.0:g} Hz."
            )
        if (self.static_response is None) == (self.lowest == 0.0):
            given = "not given" if self.static_response is None else "given"
            raise ValueError(
                f"The static response is {given} for a control band from {self.lowest:g} Hz; give it with a band from "
                "0 Hz, and only there."
            )
        if self.lowest == 0.0 and self.lower_flank != 0.0:
            raise ValueError(
                f"The flank below a control band from 0 Hz is {self.lower_flank:g} Hz wide; there is no room for one, "
                "leave it out."
            )
        if not (self.upper_flank > 0.0 and (self.lowest == 0.0 or 0.0 < self.lower_flank <= self.lowest)):
            raise ValueError(
                f"The flanks of the control band are {self.lower_flank:g} and {self.upper_flank:g} Hz wide; both must "
                f"be greater than 0 and the lower at most the band's lower edge, {self.lowest:g} Hz."
            )
        narrower = min(self.lower_flank or self.upper_flank, self.upper_flank)
        if narrower < _NARROWEST_FLANK * self.sample_rate:
            raise ValueError(
                f"A flank of the control band is {narrower:g} Hz wide; at {self.sample_rate:g} Hz it must be at least "
                f"{_NARROWEST_FLANK * self.sample_rate:g} Hz: take a wider one or a higher lower edge."
            )
        if self.highest_driven > self.sample_rate / 2.0:
            raise ValueError(
                f"The control band of {self.lowest:g} to {self.highest:g} Hz has a flank up to {self.highest_driven:g} "
                f"Hz; it must end at half the sample rate, {self.sample_rate / 2.0:g} Hz, or below: take a lower edge "
                "or a narrower flank."
            )

    @property
    def lowest_driven(self) -> float:
        """Frequency below which drives have no energy, Hz: the lower flank's end."""
        return self.lowest - self.lower_flank

    @property
    def highest_driven(self) -> float:
        """Frequency at and above which drives have no energy, Hz: the upper flank's end."""
        return self.highest + self.upper_flank

    def drive_mask(self, frequency: np.ndarray) -> NDArray[np.float64]:
        """Return the weight of each line for drives and judged responses.

        Parameters
        ----------
        frequency : ndarray, shape (lines,)
            Frequencies, Hz.

        Returns
        -------
        ndarray, shape (lines,)
            Weights, 0 to 1.
        """
        return self._mask(frequency, begins=1.0)

    def target_mask(self, frequency: np.ndarray) -> NDArray[np.float64]:
        """Return the weight of each line for the target; `drive_mask` is 1 wherever this is greater than 0.

        Parameters
        ----------
        frequency : ndarray, shape (lines,)
            Frequencies, Hz.

        Returns
        -------
        ndarray, shape (lines,)
            Weights, 0 to 1.
        """
        return self._mask(frequency, begins=0.5)

    def _mask(self, frequency: np.ndarray, *, begins: float) -> NDArray[np.float64]:
        """Return a mask whose flanks, half as wide as the band's, begin at a share of these from the band's edges."""
        lower, upper = 0.5 * self.lower_flank, 0.5 * self.upper_flank
        start, end = self.lowest - begins * self.lower_flank, self.highest + begins * self.upper_flank
        if self.lowest == 0.0:
            return band_mask(frequency, 0.0, end, edge=upper)
        # `band_mask` has edges of one width; a lower edge is the complement of a mask with an upper edge only.
        below = band_mask(frequency, 0.0, start + lower, edge=lower)
        return (1.0 - below) * band_mask(frequency, 0.0, end, edge=upper)

    @property
    def ringing_samples(self) -> int:
        """Number of zeros in which the ringing of the narrower flank decays."""
        narrower = min(self.lower_flank or self.upper_flank, self.upper_flank)
        # A mask's flank is half as wide as the band's.
        return math.ceil(_PADDING_PERIODS * self.sample_rate / (0.5 * narrower))

    def transform_samples(self, samples: int) -> int:
        """Return the length of a transform that filters a record of this length without wrap-around.

        Parameters
        ----------
        samples : int
            Length of the record, 1 or more.

        Returns
        -------
        int
            A multiple of four: the record, and zeros for the ringing before its start and after its end.
        """
        quarter = math.ceil((samples + max(samples, self.ringing_samples)) / 4)
        return 4 * cast(int, next_fast_len(quarter, real=True))

    def transform(self, samples: int) -> BandedTransform:
        """Return the transform of records of one length to the lines of the band and back, without wrap-around.

        Parameters
        ----------
        samples : int
            Length of a record, 1 or more.

        Returns
        -------
        BandedTransform
            Transform for use by one thread.
        """
        return BandedTransform(
            self.transform_samples(samples),
            sample_rate=self.sample_rate,
            lowest=self.lowest_driven,
            highest=self.highest_driven,
        )

    def limit_target(self, target: np.ndarray) -> NDArray[np.float64]:
        """Prepare the target: its dynamic part in the control band, without delay, from rest to rest.

        Parameters
        ----------
        target : ndarray, shape (channels, samples)
            Target as measured; its static part is removed as in `dynamic_part`, and the first and the last
            `TARGET_FADE_SECONDS` fade, because a rig begins and ends at rest.

        Returns
        -------
        ndarray, shape (channels, samples)
            Prepared target in the target's units.
        """
        dynamic = faded(self.dynamic_part(target), sample_rate=self.sample_rate, seconds=TARGET_FADE_SECONDS)
        return self._limit(dynamic, self.target_mask)

    def limit_response(self, response: np.ndarray) -> NDArray[np.float64]:
        """Return the judged part of a response: its dynamic part in the control band, without delay.

        Parameters
        ----------
        response : ndarray, shape (channels, samples)
            Response as measured; its static part is removed as in `dynamic_part`.

        Returns
        -------
        ndarray, shape (channels, samples)
            Judged response in the response's units.
        """
        return self._limit(self.dynamic_part(response), self.drive_mask)

    def limit_drive(self, drive: np.ndarray) -> NDArray[np.float64]:
        """Return a drive limited to the band, without delay.

        Parameters
        ----------
        drive : ndarray, shape (n_u, samples)
            Drive, including its parts outside the band.

        Returns
        -------
        ndarray, shape (n_u, samples)
            Limited drive in the drive's units.
        """
        return self._limit(np.array(drive, dtype=np.float64), self.drive_mask)

    def dynamic_part(self, samples: np.ndarray) -> NDArray[np.float64]:
        """Return a record without its static part, not limited to the band.

        Parameters
        ----------
        samples : ndarray, shape (channels, samples)
            Record as measured; its static part is the line between its levels at start and end. For a band from 0 Hz it
            is only the static response: a mean or a drift stays.

        Returns
        -------
        ndarray, shape (channels, samples)
            Dynamic part in the record's units.

        Raises
        ------
        ValueError
            The record is not valid, or its number of channels is not that of `static_response`.
        """
        if self.static_response is not None:
            record = as_record(samples, name="record")
            if record.shape[0] != len(self.static_response):
                raise ValueError(
                    f"The record has {record.shape[0]} channels; the control band from 0 Hz has the static response of "
                    f"{len(self.static_response)}."
                )
            return record - np.array(self.static_response)[:, None]
        return dynamic_part(samples, lowest=self.lowest, sample_rate=self.sample_rate)

    def _limit(
        self, limited: NDArray[np.float64], mask: Callable[[np.ndarray], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Limit a record to the lines of a mask, in place."""
        transform = self.transform(limited.shape[1])
        weight = mask(transform.frequency)
        lines = np.empty(weight.size, dtype=np.complex128)
        for row in limited:
            transform.lines(row, weight=weight, out=lines)
            transform.samples(lines, out=row)
        return limited

    def static_levels(self, samples: np.ndarray) -> NDArray[np.float64]:
        """Return the levels at start and end that define a record's static part, for a band above 0 Hz.

        Parameters
        ----------
        samples : ndarray, shape (channels, samples)
            Record as measured.

        Returns
        -------
        ndarray, shape (channels, 2)
            Levels in the record's units.
        """
        return static_levels(samples, lowest=self.lowest, sample_rate=self.sample_rate)


def control_band(
    lowest: float,
    highest: float,
    *,
    sample_rate: float,
    excited: tuple[float, float] | None = None,
    lower_flank: float | None = None,
    upper_flank: float | None = None,
    static_response: Iterable[float] | None = None,
) -> ControlBand:
    """Return a control band whose flanks fit into the excited band.

    Parameters
    ----------
    lowest, highest : float
        Edges, Hz; `0 <= lowest < highest < sample_rate / 2`. The target is whole between them.
    sample_rate : float
        Sample rate of all records, Hz.
    excited : tuple of float, optional
        Lowest and highest frequency at which the rig is identified, Hz, the lowest 0 if its static gain is
        identified; the band and its flanks must lie within.
    lower_flank, upper_flank : float, optional
        Width of the flank below and above, Hz. If not given: half of `lowest` and a tenth of `highest`, or the room
        in the excited band if that is less and at least a quarter of it. A narrow flank rings longer.
    static_response : iterable of float, optional
        Response of each channel at drive 0, for a band from 0 Hz; see `ControlBand`.

    Returns
    -------
    ControlBand
        Control band; drives have energy in it and in its flanks.

    Raises
    ------
    ValueError
        Edges or flanks out of range, or outside the excited band.
    """
    rest = None if static_response is None else tuple(float(level) for level in static_response)
    usual = _LOWER_FLANK_SHARE * lowest, _UPPER_FLANK_SHARE * highest
    given = lower_flank, upper_flank
    if excited is None:
        flanks = [wanted if width is None else width for wanted, width in zip(usual, given, strict=True)]
        return ControlBand(lowest, highest, sample_rate, *flanks, static_response=rest)
    room = lowest - excited[0], excited[1] - highest
    flanks = [
        min(wanted, max(left, _NARROWEST_SHARE * wanted)) if width is None else width
        for wanted, width, left in zip(usual, given, room, strict=True)
    ]
    band = ControlBand(lowest, highest, sample_rate, *flanks, static_response=rest)
    for width, left, side, edge in zip(flanks, room, ("below", "above"), excited, strict=True):
        if width > left * (1.0 + _ROUNDING):
            remedy = "excite a wider band or control a narrower one"
            if left > 0.0:
                remedy += f", or state a flank of at most {left:.3g} Hz, which rings longer"
            raise ValueError(
                f"The control band of {lowest:g} to {highest:g} Hz has a flank of {width:.3g} Hz {side} it, from "
                f"{band.lowest_driven:g} to {band.highest_driven:g} Hz in all; it must lie in the excited band, which "
                f"{'begins' if side == 'below' else 'ends'} at {edge:g} Hz: {remedy}."
            )
    return band
