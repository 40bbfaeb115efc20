"""Predicted convergence of the next playbacks: the spectral radius of Eq. 6 and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iterator.model import RigModel, driven_lines
from iterator.updates.gains import gain_at
from iterator.updates.settings import UpdateSettings


@dataclass(frozen=True)
class ConvergencePrediction:
    """Factor of the error from one playback to the next, at the lines with drive.

    Parameters
    ----------
    frequency : ndarray, shape (driven,)
        Hz.
    spectral_radius : ndarray, shape (driven,)
        Of `I - Ĥ† Q H` for the likeliest rig; it converges if and only if this is below 1.
    deviation : ndarray, shape (driven,)
        Standard deviation of that matrix (Frobenius norm) over the rigs that the identification's uncertainty allows;
        0 where that is not known.
    """

    frequency: NDArray[np.float64]
    spectral_radius: NDArray[np.float64]
    deviation: NDArray[np.float64]

    def diverging(self, deviations: float = 2.0) -> NDArray[np.float64]:
        """Return the frequencies at which the error may grow.

        Parameters
        ----------
        deviations : float
            Standard deviations added to the spectral radius, 0 or more.

        Returns
        -------
        ndarray, shape (found,)
            Hz, rising.
        """
        return self.frequency[self.spectral_radius + deviations * self.deviation >= 1.0]


def predict_convergence(model: RigModel, settings: UpdateSettings, *, playbacks: int) -> ConvergencePrediction:
    """Predict how the error shrinks with the inverse and the gains of the next update.

    Parameters
    ----------
    model : RigModel
        As the last update returned it: the rig is taken for its FRF, give or take the identification's uncertainty.
    settings : UpdateSettings
        Control band and gains.
    playbacks : int
        Made so far, 0 or more.

    Returns
    -------
    ConvergencePrediction
        Of the part of the error that the drives can reach.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 4 to 6. `I - Ĥ† Q H` has the eigenvalues of `I - H Ĥ† Q` without those of
    the part that more responses than drives leave out of reach.
    """
    lines = driven_lines(model, settings.band)
    frequency = model.frequency[lines]
    gain = gain_at(frequency, settings, playbacks=playbacks)
    inverse = model.inverse_frf[lines] * gain[:, None, :]
    left = np.eye(inverse.shape[1]) - np.matmul(inverse, model.frf[lines])
    radius = np.abs(np.linalg.eigvals(left)).max(axis=1)
    deviation = np.zeros_like(radius)
    if model.uncertainty is not None:
        spread = np.einsum("fii->fi", model.uncertainty.row_covariance[lines]).real
        # Drives count by the level they were identified with, so that units do not count.
        scale = 1.0 / np.sqrt(np.mean(spread, axis=0))
        power = np.sum(np.abs(inverse / scale[:, None]) ** 2, axis=1)
        doubt = np.sum(power * model.uncertainty.residual_psd[lines], axis=1)
        deviation = np.sqrt(doubt * np.sum(spread * scale**2, axis=1))
    return ConvergencePrediction(frequency=frequency, spectral_radius=radius, deviation=deviation)
