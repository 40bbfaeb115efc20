"""What an experiment is told to do, checked by itself where it enters."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spectra import hop_samples

SMALLEST_BLOCK_SAMPLES = 256
"""Fewer samples leave too few lines for an impulse response that dies out."""


class SettingError(ValueError):
    """A setting that is not allowed.

    Parameters
    ----------
    message
        One sentence: the value, what is allowed, what to do.
    field
        Path of the field of `duralab.v1.IdentifyRequest` that is wrong.
    """

    def __init__(self, message: str, *, field: str) -> None:
        super().__init__(message)
        self.field = field


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
        field = "excitation.spectrum"
        if not (0.0 < self.lowest_frequency < self.highest_frequency < np.inf):
            raise SettingError(
                f"The band runs from {self.lowest_frequency} to {self.highest_frequency} Hz; "
                "it must begin above 0 and end above its beginning.",
                field=f"{field}.highest_frequency",
            )
        if not self.lowest_frequency <= self.corner_frequency <= self.highest_frequency:
            raise SettingError(
                f"The corner is at {self.corner_frequency} Hz; it must lie in the band from {self.lowest_frequency} to "
                f"{self.highest_frequency} Hz.",
                field=f"{field}.corner_frequency",
            )
        if not 0.0 <= self.decibels_per_octave < np.inf:
            raise SettingError(
                f"The PSD is to fall by {self.decibels_per_octave} dB per octave; it must be 0 or more and finite.",
                field=f"{field}.decibels_per_octave",
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
        inside = self.contains(frequency)
        octaves = np.log2(np.maximum(frequency, self.corner_frequency) / self.corner_frequency)
        return np.where(inside, 10.0 ** (-self.decibels_per_octave * octaves / 10.0), 0.0)

    def contains(self, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each frequency lies in the band.

        Parameters
        ----------
        frequency
            Shape (lines), in hertz.

        Returns
        -------
        numpy.ndarray
            Shape (lines), boolean; the limits belong to the band.
        """
        return (frequency >= self.lowest_frequency) & (frequency <= self.highest_frequency)


@dataclass(frozen=True)
class ExperimentSettings:
    """One identification: what is played, for how long, and how the record is averaged.

    Parameters
    ----------
    spectrum
        Shape of every drive's PSD.
    rms
        RMS of each drive between the fades, in its unit, each greater than 0.
    duration_seconds
        Length of the drive, fades included, greater than 0.
    fade_seconds
        Linear fade at either end, 0 or more; dropped from the estimate.
    seed
        Of the excitation, 0 to 2^64 - 1.
    block_samples
        Samples in a block, even, 256 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.

    Raises
    ------
    SettingError
        Where a value is not allowed whatever the rig.
    """

    spectrum: WhitePink
    rms: tuple[float, ...]
    duration_seconds: float
    fade_seconds: float
    seed: int
    block_samples: int
    overlap: float

    def __post_init__(self) -> None:
        for index, level in enumerate(self.rms):
            if not 0.0 < level < np.inf:
                raise SettingError(
                    f"The RMS of drive {index} is {level}; every RMS must be finite and greater than 0.",
                    field="excitation.rms",
                )
        if not 0.0 < self.duration_seconds < np.inf:
            raise SettingError(
                f"The excitation lasts {self.duration_seconds} s; it must be finite and greater than 0.",
                field="excitation.duration_seconds",
            )
        if not 0.0 <= self.fade_seconds < self.duration_seconds / 2.0:
            raise SettingError(
                f"The fade lasts {self.fade_seconds} s; it must be 0 or more and less than half the excitation, "
                f"{self.duration_seconds / 2.0:g} s.",
                field="excitation.fade_seconds",
            )
        if not 0 <= self.seed < 2**64:
            raise SettingError(f"The seed is {self.seed}; it must be from 0 to 2^64 - 1.", field="excitation.seed")
        if self.block_samples < SMALLEST_BLOCK_SAMPLES or self.block_samples % 2 != 0:
            raise SettingError(
                f"The block has {self.block_samples} samples; it must be even and {SMALLEST_BLOCK_SAMPLES} or more.",
                field="estimator.block_samples",
            )
        try:
            hop_samples(self.block_samples, self.overlap)
        except ValueError as error:
            raise SettingError(str(error), field="estimator.overlap") from error

    def samples(self, sample_rate: float) -> int:
        """Count the samples of the whole drive.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to duration times rate.
        """
        return round(self.duration_seconds * sample_rate)

    def fade_samples(self, sample_rate: float) -> int:
        """Count the samples of one fade.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to fade times rate.
        """
        return round(self.fade_seconds * sample_rate)
