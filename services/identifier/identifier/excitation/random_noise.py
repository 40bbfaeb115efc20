"""Pure random: Gaussian noise shaped to a PSD, independent for every drive."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from duralab_settings import PowerSpectrum
from duralab_spectra import line_frequencies, require_sample_rate
from identifier.excitation.fades import linear_fades
from identifier.excitation.power_spectrum import power_density
from identifier.excitation.random_streams import random_stream


def pure_random(
    spectrum: PowerSpectrum | Sequence[PowerSpectrum],
    *,
    rms: Sequence[float],
    samples: int,
    fade_samples: int,
    sample_rate: float,
    seed: int,
) -> NDArray[np.float64]:
    """Return Gaussian noise shaped to a PSD, independent for every drive.

    Every line of the record gets a complex Gaussian amplitude, so only the fades add content beyond the band.

    Parameters
    ----------
    spectrum
        Shape of the PSD, one for all drives or one for each; every band must hold a line of the record.
    rms
        RMS of each drive between the fades, in its unit; met exactly.
    samples
        Length of the record, 2 or more.
    fade_samples
        Samples of the linear fade at either end, 0 up to less than half the record.
    sample_rate
        Sample rate in hertz, greater than 0.
    seed
        Root of one independent stream per drive; a drive's stream does not depend on the number of drives.

    Returns
    -------
    numpy.ndarray
        Shape (drives, samples).

    Raises
    ------
    ValueError
        The record is shorter than its fades or than one period of the band.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*; the excitation "pure random" of Cornelis et al., ISMA 2014.
    """
    require_sample_rate(sample_rate)
    if fade_samples < 0 or samples < 2 or 2 * fade_samples >= samples:
        raise ValueError(
            f"Fades of {fade_samples} samples at both ends of {samples} leave nothing between; take shorter fades."
        )
    shapes = spectrum if isinstance(spectrum, Sequence) else [spectrum] * len(rms)
    drive = np.empty((len(rms), samples))
    for index, (shape, level) in enumerate(zip(shapes, rms, strict=True)):
        noise = shaped_noise(shape, samples=samples, sample_rate=sample_rate, generator=random_stream(seed, index))
        drive[index] = noise * (level / np.sqrt(np.mean(noise[fade_samples : samples - fade_samples] ** 2)))
    drive *= linear_fades(samples, fade_samples)
    return drive


def shaped_noise(
    spectrum: PowerSpectrum, *, samples: int, sample_rate: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return Gaussian noise whose PSD has a given shape; its scale has no meaning."""
    density = power_density(spectrum, line_frequencies(samples, sample_rate))
    if not density.any():
        raise ValueError(
            f"A record of {samples / sample_rate:g} s has no line from {spectrum.lowest_frequency:g} to "
            f"{spectrum.highest_frequency:g} Hz; take a longer one or a wider band."
        )
    lines = generator.standard_normal((2, density.size))
    return np.asarray(fft.irfft(np.sqrt(density) * (lines[0] + 1j * lines[1]), samples), dtype=np.float64)
