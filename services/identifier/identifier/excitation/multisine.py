"""Multisines: their lines, the amplitudes of the lines, and the block of lines and phases."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from duralab_settings import PowerSpectrum
from identifier.excitation.power_spectrum import in_band, power_density
from identifier.excitation.random_streams import Purpose, random_stream


def choose_lines(
    spectrum: PowerSpectrum, *, frequency: NDArray[np.float64], odd: bool, detection_share: float, seed: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Choose the excited lines, and the lines of the band that are left out to detect distortion.

    One of every ``1 / detection_share`` neighbouring possible lines (the nearest whole number of them), drawn at
    random, is left out: evenly spread, without a pattern that a distortion could share. The choice is the same for the
    whole experiment.

    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, chapter 4.
    """
    band = in_band(spectrum, frequency)
    band[[0, -1]] = False
    excited = band.copy()
    if odd:
        excited[::2] = False
    if detection_share > 0.0:
        candidates = np.flatnonzero(excited)
        # The inverse of a very small share may not be finite; bounded, it leaves out none of the lines.
        group = round(1.0 / max(detection_share, 1.0 / (candidates.size + 1)))
        groups = candidates.size // group
        drawn = random_stream(seed, Purpose.DETECTION_LINES).integers(group, size=groups)
        excited[candidates[np.arange(groups) * group + drawn]] = False
    return excited, band & ~excited


def line_amplitudes(
    spectra: Sequence[PowerSpectrum], *, frequency: NDArray[np.float64], excited: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the amplitudes of the sines for a block of RMS 1, for any phases."""
    power = np.stack([power_density(spectrum, frequency) for spectrum in spectra]) * excited
    return np.sqrt(2.0 * power / power.sum(axis=1, keepdims=True))


def block_of(lines: NDArray[np.complex128], block_samples: int) -> NDArray[np.float64]:
    """Return one period of the sum of cosines with these complex amplitudes (Eq. 7).

    Source: Cornelis et al., ISMA 2014, Eq. 7.
    """
    return np.asarray(fft.irfft(lines * (block_samples / 2.0), block_samples, axis=-1), dtype=np.float64)
