"""Burst random: noise that stops early enough for the response to die out before the block ends."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from duralab_settings import PowerSpectrum
from identifier.excitation.fades import linear_fades
from identifier.excitation.random_noise import shaped_noise
from identifier.excitation.random_streams import Purpose, random_stream


def burst_random(
    spectra: Sequence[PowerSpectrum],
    *,
    bursts: int,
    block_samples: int,
    burst_samples: int,
    fade_samples: int,
    sample_rate: float,
    seed: int,
) -> NDArray[np.float64]:
    """Return independent bursts of Gaussian noise, one at the beginning of every block, followed by rest.

    A burst widens the band by about one over its length, so that a block begins and ends at rest.

    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, chapter 5.
    """
    gate = np.zeros(block_samples)
    gate[:burst_samples] = linear_fades(burst_samples, fade_samples)
    drive = np.empty((len(spectra), bursts, block_samples))
    for index, spectrum in enumerate(spectra):
        for burst in range(bursts):
            stream = random_stream(seed, Purpose.BURST, burst, index)
            noise = shaped_noise(spectrum, samples=block_samples, sample_rate=sample_rate, generator=stream)
            drive[index, burst] = gate * noise
    return drive.reshape(len(spectra), bursts * block_samples)
