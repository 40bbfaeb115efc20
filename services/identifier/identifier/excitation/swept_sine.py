"""Swept sine: one sweep per block, slow where the PSD is high, with signs that decorrelate the drives."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from duralab_settings import PowerSpectrum
from identifier.excitation.fades import linear_fades
from identifier.excitation.hadamard import sign_matrix
from identifier.excitation.power_spectrum import power_density

_STEPS = 4096
"""Number of frequencies at which the passing time is computed; between them it is nearly linear."""


def swept_sine(
    spectra: Sequence[PowerSpectrum],
    *,
    sets: int,
    block_samples: int,
    sweep_samples: int,
    fade_samples: int,
    sample_rate: float,
) -> NDArray[np.float64]:
    """Return sweeps of all drives at once, each block with the signs of one column of a Hadamard matrix.

    Over a whole set of columns the drives are orthogonal for any sweeps, so `S_uu` is diagonal.
    """
    block = np.zeros((len(spectra), block_samples))
    fades = linear_fades(sweep_samples, fade_samples)
    sweeping = sweep_samples - 2 * fade_samples
    for index, spectrum in enumerate(spectra):
        block[index, :sweep_samples] = fades * np.sin(
            _phase(spectrum, samples=sweeping, held=fade_samples, sample_rate=sample_rate)
        )
    signs = sign_matrix(len(spectra))
    return np.tile((signs[:, :, None] * block[:, None, :]).reshape(len(spectra), -1), (1, sets))


def _phase(spectrum: PowerSpectrum, *, samples: int, held: int, sample_rate: float) -> NDArray[np.float64]:
    """Return the phase of one sweep of constant amplitude, in radians, with its first and last frequency held.

    The energy of a sine of constant amplitude at a frequency is proportional to the time that it spends there
    (stationary phase), so the passing time of a frequency is the integral of the PSD up to it.
    """
    frequency = np.linspace(spectrum.lowest_frequency, spectrum.highest_frequency, _STEPS)
    density = power_density(spectrum, frequency)
    passed = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    now = np.interp(np.arange(-held, samples + held), passed * ((samples - 1) / passed[-1]), frequency)
    return 2.0 * np.pi / sample_rate * np.concatenate([[0.0], np.cumsum((now[1:] + now[:-1]) / 2.0)])
