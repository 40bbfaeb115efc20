"""Density of a drive's power spectrum: white, white-pink, or a table."""

import numpy as np
from numpy.typing import NDArray

from duralab_settings import PowerSpectrum, TabulatedSpectrum, WhitePinkSpectrum


def white(lowest_frequency: float, highest_frequency: float) -> WhitePinkSpectrum:
    """Return a PSD that is flat in a band, zero outside.

    Parameters
    ----------
    lowest_frequency, highest_frequency
        Band, in hertz, both included, 0 < lowest < highest.

    Returns
    -------
    WhitePinkSpectrum
        Spectrum with its corner at the upper edge.

    Raises
    ------
    ValueError
        The band is not valid.
    """
    return WhitePinkSpectrum(
        lowest_frequency=lowest_frequency,
        highest_frequency=highest_frequency,
        corner_frequency=highest_frequency,
        decibels_per_octave=0.0,
    )


def power_density(spectrum: PowerSpectrum, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shape of a PSD; its scale is set by the drive's level.

    A table is linear on logarithmic axes between its points, as in test specifications: a constant number of decibels
    per octave.

    `spectrum`: White-pink spectrum, or a table. `frequency`: Shape (lines), in hertz.
    Returns: Shape (lines), 0 outside the band; 1 on the flat part, or in the unit of the table.
    """
    inside = in_band(spectrum, frequency)
    if isinstance(spectrum, TabulatedSpectrum):
        shape = np.zeros(frequency.shape)
        points = np.log(spectrum.frequency), np.log(spectrum.density)
        shape[inside] = np.exp(np.interp(np.log(frequency[inside]), *points))
        return shape
    octaves = np.log2(np.maximum(frequency, spectrum.corner_frequency) / spectrum.corner_frequency)
    return np.where(inside, 10.0 ** (-spectrum.decibels_per_octave * octaves / 10.0), 0.0)


def in_band(spectrum: PowerSpectrum, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each frequency is in a spectrum's band."""
    return (frequency >= spectrum.lowest_frequency) & (frequency <= spectrum.highest_frequency)
