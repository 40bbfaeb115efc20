"""Multisines: which lines they have, how large these are, and the block that lines and phases make."""

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
    """Choose the lines that are excited and those of the band that are left out to see distortion.

    Of every ``1 / detection_share`` neighbouring lines (the nearest whole number of them) that could be excited one,
    drawn at random, is left out: evenly spread, and with no pattern that a distortion could share. The choice holds for
    the whole experiment.

    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, chapter 4.
    """
    band = in_band(spectrum, frequency)
    band[[0, -1]] = False
    excited = band.copy()
    if odd:
        excited[::2] = False
    if detection_share > 0.0:
        candidates = np.flatnonzero(excited)
        # A share that leaves out none of so many lines may have an inverse that is no number.
        group = round(1.0 / max(detection_share, 1.0 / (candidates.size + 1)))
        groups = candidates.size // group
        drawn = random_stream(seed, Purpose.DETECTION_LINES).integers(group, size=groups)
        excited[candidates[np.arange(groups) * group + drawn]] = False
    return excited, band & ~excited


def line_amplitudes(
    spectra: Sequence[PowerSpectrum], *, frequency: NDArray[np.float64], excited: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Amplitudes of the sines for a block of RMS 1, whatever their phases."""
    power = np.stack([power_density(spectrum, frequency) for spectrum in spectra]) * excited
    return np.sqrt(2.0 * power / power.sum(axis=1, keepdims=True))


def block_of(lines: NDArray[np.complex128], block_samples: int) -> NDArray[np.float64]:
    """One period of the sum of cosines with these complex amplitudes (Eq. 7).

    Source: Cornelis et al., ISMA 2014, Eq. 7.
    """
    return np.asarray(fft.irfft(lines * (block_samples / 2.0), block_samples, axis=-1), dtype=np.float64)
