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
        Frequencies, Hz.
    spectral_radius : ndarray, shape (driven,)
        Spectral radius of `I - Ĥ† Q H` for the likeliest rig; it converges if and only if this is below 1.
    deviation : ndarray, shape (driven,)
        Standard deviation of that matrix (Frobenius norm, drives scaled to equal uncertainty in every direction) over
        the rigs within the identification's uncertainty; 0 if that is not known.
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
            Frequencies, Hz, rising.
        """
        return self.frequency[self.spectral_radius + deviations * self.deviation >= 1.0]


def predict_convergence(model: RigModel, settings: UpdateSettings, *, playbacks: int) -> ConvergencePrediction:
    """Predict the decrease of the error with the inverse and the gains of the next update.

    Parameters
    ----------
    model : RigModel
        Result of the last update: the rig is assumed to be its FRF, within the identification's uncertainty.
    settings : UpdateSettings
        Settings with the control band and gains.
    playbacks : int
        Number of playbacks so far, 0 or more.

    Returns
    -------
    ConvergencePrediction
        Prediction for the part of the error that the drives can reach.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 4 to 6. `I - Ĥ† Q H` has the eigenvalues of `I - H Ĥ† Q` except those of
    the part that is out of reach because of more responses than drives.
    """
    lines = driven_lines(model, settings.band)
    frequency = model.frequency[lines]
    gain = gain_at(frequency, settings, playbacks=playbacks)
    inverse = model.inverse_frf[lines] * gain[:, None, :]
    left = np.eye(inverse.shape[1]) - np.matmul(inverse, model.frf[lines])
    radius = np.abs(np.linalg.eigvals(left)).max(axis=1)
    deviation = np.zeros_like(radius)
    if model.uncertainty is not None:
        covariance = model.uncertainty.row_covariance[lines]
        # In coordinates of the drives in which every direction is equally uncertain: units do not count, nor does how
        # closely drives followed each other in the identification.
        power = np.einsum("fki,fkj,fji->fi", inverse, covariance, inverse.conj(), optimize=True).real
        doubt = np.sum(power * model.uncertainty.residual_psd[lines], axis=1)
        deviation = np.sqrt(inverse.shape[1] * np.maximum(doubt, 0.0))
    return ConvergencePrediction(frequency=frequency, spectral_radius=radius, deviation=deviation)
