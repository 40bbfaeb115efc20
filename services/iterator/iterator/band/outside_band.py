"""Content of a target outside the control band, which is reported because it is neither reproduced nor judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import line_frequencies
from iterator.band.band import ControlBand


@dataclass(frozen=True)
class OutsideBand:
    """Energy of a target's dynamic part outside the control band; except for a band from 0 Hz, without its mean.

    Parameters
    ----------
    below, above : ndarray, shape (n_y,)
        Share of each channel's energy below and above the band's edges, 0 to 1; the square root is the share of the
        RMS. 0 for a channel that does not move.
    """

    below: NDArray[np.float64]
    above: NDArray[np.float64]


def energy_outside_band(target: NDArray[np.float64], band: ControlBand) -> OutsideBand:
    """Return the energy of a target outside the control band.

    Parameters
    ----------
    target : ndarray, shape (n_y, samples)
        Target as measured.
    band : ControlBand
        Control band of the campaign.

    Returns
    -------
    OutsideBand
        Shares of energy.

    Raises
    ------
    ValueError
        The target is not a record or not finite.

    Notes
    -----
    Source: Parseval's theorem on the zero-padded record.
    """
    dynamic = band.dynamic_part(target)
    if band.lowest > 0.0:
        # The mean of a ride with rest before and after it is static, too.
        dynamic -= dynamic.mean(axis=1, keepdims=True)
    length = band.transform_samples(dynamic.shape[1])
    frequency = line_frequencies(length, band.sample_rate)
    energy = np.abs(np.fft.rfft(dynamic, length, axis=1)) ** 2
    # Every line except those at 0 and at half the sample rate also counts for its negative frequency.
    energy[:, 1:-1] *= 2.0
    total = energy.sum(axis=1)
    sides = frequency < band.lowest, frequency > band.highest
    moves = total > 0.0
    below, above = (
        np.divide(energy[:, side].sum(axis=1), total, out=np.zeros_like(total), where=moves) for side in sides
    )
    return OutsideBand(below=below, above=above)
