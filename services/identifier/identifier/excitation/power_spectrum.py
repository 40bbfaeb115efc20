"""Shapes of a drive's power spectral density: white, white-pink, or a table."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from identifier.setting_error import SettingError

_FIELD, _TABLE = "excitation.spectrum", "excitation.drive_spectra"


class PowerSpectrum(Protocol):
    """Shape of a PSD in a band; its scale is set by the drive's level.

    Parameters
    ----------
    lowest_frequency, highest_frequency
        Band, in hertz, both included.
    """

    @property
    def lowest_frequency(self) -> float:
        """Lower edge of the band, in hertz, greater than 0."""
        ...

    @property
    def highest_frequency(self) -> float:
        """Upper edge of the band, in hertz."""
        ...

    def density(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shape of the PSD at each frequency, greater than 0 in the band and 0 outside."""
        ...


@dataclass(frozen=True)
class White:
    """Flat PSD in a band, zero outside.

    Parameters
    ----------
    lowest_frequency, highest_frequency
        Band, in hertz, both included, 0 < lowest < highest.

    Raises
    ------
    SettingError
        Where the band is not one.
    """

    lowest_frequency: float
    highest_frequency: float

    def __post_init__(self) -> None:
        _check_band(self.lowest_frequency, self.highest_frequency)

    def density(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shape of the PSD.

        Parameters
        ----------
        frequency
            Shape (lines), in hertz.

        Returns
        -------
        numpy.ndarray
            Shape (lines), 1 in the band, 0 outside.
        """
        return in_band(self, frequency).astype(np.float64)


@dataclass(frozen=True)
class WhitePink:
    """PSD that is flat from the band's lower edge to a corner, then falls to the band's upper edge; zero outside.

    Parameters
    ----------
    lowest_frequency, highest_frequency
        Band, in hertz, both included, 0 < lowest < highest.
    corner_frequency
        End of the flat part, in hertz, within the band.
    decibels_per_octave
        Fall of the PSD above the corner, 0 (white) or more.

    Raises
    ------
    SettingError
        Where a value is not allowed.
    """

    lowest_frequency: float
    highest_frequency: float
    corner_frequency: float
    decibels_per_octave: float

    def __post_init__(self) -> None:
        _check_band(self.lowest_frequency, self.highest_frequency)
        if not self.lowest_frequency <= self.corner_frequency <= self.highest_frequency:
            raise SettingError(
                f"The corner is at {self.corner_frequency} Hz; it must lie in the band from {self.lowest_frequency} to "
                f"{self.highest_frequency} Hz.",
                field=f"{_FIELD}.corner_frequency",
            )
        if not 0.0 <= self.decibels_per_octave < np.inf:
            raise SettingError(
                f"The PSD is to fall by {self.decibels_per_octave} dB per octave; it must be 0 or more and finite.",
                field=f"{_FIELD}.decibels_per_octave",
            )

    def density(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shape of the PSD.

        Parameters
        ----------
        frequency
            Shape (lines), in hertz.

        Returns
        -------
        numpy.ndarray
            Shape (lines), 1 on the flat part, 0 outside the band.
        """
        octaves = np.log2(np.maximum(frequency, self.corner_frequency) / self.corner_frequency)
        return np.where(in_band(self, frequency), 10.0 ** (-self.decibels_per_octave * octaves / 10.0), 0.0)


@dataclass(frozen=True)
class TabulatedSpectrum:
    """PSD given at frequencies, straight between them on logarithmic axes; zero outside the table.

    Straight on logarithmic axes is how test specifications draw a PSD: a constant number of decibels per octave.

    Parameters
    ----------
    frequencies
        In hertz, two or more, rising, greater than 0.
    densities
        Density at each, in any unit, finite and greater than 0; only their ratios count.

    Raises
    ------
    SettingError
        Where the table is not one.
    """

    frequencies: tuple[float, ...]
    densities: tuple[float, ...]

    def __post_init__(self) -> None:
        frequencies, densities = self.frequencies, self.densities
        if len(frequencies) != len(densities) or len(frequencies) < 2:
            raise SettingError(
                f"The PSD's table has {len(frequencies)} frequencies and {len(densities)} densities; "
                "give two or more of each, one density for each frequency.",
                field=_TABLE,
            )
        for index, density in enumerate(densities):
            if not 0.0 < density < np.inf:
                raise SettingError(
                    f"The PSD is {density} at {frequencies[index]} Hz; every density must be finite and greater than "
                    "0, so give a small one or end the table there.",
                    field=_TABLE,
                )
        _check_band(frequencies[0], frequencies[-1], field=_TABLE)
        for before, after in pairwise(frequencies):
            if not before < after:
                raise SettingError(
                    f"The PSD's table goes from {before} to {after} Hz; its frequencies must rise, so sort them and "
                    "leave out doubles.",
                    field=_TABLE,
                )

    @property
    def lowest_frequency(self) -> float:
        """Lower edge of the band, in hertz."""
        return self.frequencies[0]

    @property
    def highest_frequency(self) -> float:
        """Upper edge of the band, in hertz."""
        return self.frequencies[-1]

    def density(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shape of the PSD.

        Parameters
        ----------
        frequency
            Shape (lines), in hertz.

        Returns
        -------
        numpy.ndarray
            Shape (lines), 0 outside the table.
        """
        inside = in_band(self, frequency)
        shape = np.zeros(frequency.shape)
        shape[inside] = np.exp(np.interp(np.log(frequency[inside]), np.log(self.frequencies), np.log(self.densities)))
        return shape


def in_band(spectrum: PowerSpectrum, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each frequency lies in a spectrum's band.

    Parameters
    ----------
    spectrum
        Whose band it is.
    frequency
        Shape (lines), in hertz.

    Returns
    -------
    numpy.ndarray
        Shape (lines), boolean; the limits belong to the band.
    """
    return (frequency >= spectrum.lowest_frequency) & (frequency <= spectrum.highest_frequency)


def _check_band(lowest: float, highest: float, *, field: str = f"{_FIELD}.highest_frequency") -> None:
    if not 0.0 < lowest < highest < np.inf:
        raise SettingError(
            f"The band runs from {lowest} to {highest} Hz; it must begin above 0 and end above its beginning.",
            field=field,
        )
