"""Identified rig for the iteration: FRF matrix and inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_frf, band_mask
from iterator.band import ControlBand
from iterator.model.drive_terms import DriveTerm
from iterator.model.history import Playback
from iterator.model.inversion import cautious_inverse, weighted_inverse
from iterator.model.rate_limit import RateLimit
from iterator.model.step_spectra import ForeseenStep, SeenStep

FEWEST_LINES: Final = 4
"""Smallest number of lines in the identified band, because a cubic is fitted to them."""


@dataclass(frozen=True)
class ModelUncertainty:
    """Covariance of the identified FRF matrix: `E[δ_ij conj(δ_ik)] = residual_psd_i row_covariance_jk` at each line.

    Parameters
    ----------
    residual_psd : ndarray, shape (lines, n_y)
        PSD of the part of the responses that the drives do not explain, response unit²/Hz.
    row_covariance : ndarray, shape (lines, n_u, n_u)
        Row covariance, Hermitian, Hz per drive unit²; positive definite at the identified lines.
    """

    residual_psd: NDArray[np.float64]
    row_covariance: NDArray[np.complex128]


@dataclass(frozen=True)
class RigModel:
    """FRF matrix `Ĥ` and its inverse `Ĥ†` at the lines of a block; made by `rig_model`.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Frequencies, Hz, from 0 to half the sample rate.
    frf : ndarray, shape (lines, n_y, n_u)
        FRF, response unit per drive unit, e^{+jwt}; 0 outside the identified lines.
    inverse_frf : ndarray, shape (lines, n_u, n_y)
        Inverse, drive unit per response unit; 0 outside the identified lines.
    identified : slice
        Lines at which the experiment's drives had energy.
    response_weight : ndarray, shape (n_y,), optional
        Weights of the pseudo-inverse; 0 for a monitored response. None: equal weights.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the identification.
    identified_frf : ndarray, shape (lines, n_y, n_u), optional
        `H_0`, if an update corrected `frf`.
    seen_steps : tuple of SeenStep
        Steps that an update used for the correction: the next update need not compute their spectra again.
    terms : tuple of DriveTerm
        Nonlinear terms of the drives that an update learned.
    term_frf : ndarray, shape (lines, n_y, terms n_u), optional
        FRF of the terms, term after term, response unit per drive unit to the power of 2 or 3; None without terms.
    foreseen_steps : tuple of ForeseenStep
        Prediction errors of the models before each of the seen steps.
    rate_limits : tuple of RateLimit or None
        Rate limits of the actuators that an update used, one for each drive; empty before it looked.
    stated_rate_limits : tuple of RateLimit or None
        Rate limits that the rig states, one for each drive; if there are any, an update uses them and looks for none.
    earlier : tuple of tuple of Playback
        Playbacks of earlier campaigns on the same rig, one tuple for each campaign: an update that learns from steps
        also learns from theirs, in this order before its own.
    """

    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    inverse_frf: NDArray[np.complex128]
    identified: slice
    response_weight: NDArray[np.float64] | None = None
    uncertainty: ModelUncertainty | None = None
    identified_frf: NDArray[np.complex128] | None = None
    seen_steps: tuple[SeenStep, ...] = ()
    terms: tuple[DriveTerm, ...] = ()
    term_frf: NDArray[np.complex128] | None = None
    foreseen_steps: tuple[ForeseenStep, ...] = ()
    rate_limits: tuple[RateLimit | None, ...] = ()
    stated_rate_limits: tuple[RateLimit | None, ...] = ()
    earlier: tuple[tuple[Playback, ...], ...] = ()

    @property
    def block_samples(self) -> int:
        """Number of samples of a block whose transform has the model's lines."""
        return 2 * (self.frequency.size - 1)


def rig_model(
    frequency: ArrayLike,
    frf: ArrayLike,
    *,
    identified_band: tuple[float, float],
    response_weight: ArrayLike | None = None,
    uncertainty: ModelUncertainty | None = None,
    caution: float = 0.0,
    regularisation: float = 0.0,
    static_gain: ArrayLike | None = None,
) -> RigModel:
    """Make the model that a campaign starts from, with the (weighted) pseudo-inverse at each identified line.

    Parameters
    ----------
    frequency : array_like, shape (lines,)
        Frequencies, Hz, from 0 to half the sample rate, equally spaced.
    frf : array_like, shape (lines, n_y, n_u)
        FRF, response unit per drive unit, `n_y >= n_u`, finite inside the identified band.
    identified_band : tuple of float
        Lowest and highest frequency with drive energy in the experiment, Hz.
    response_weight : array_like, shape (n_y,), optional
        Weight of each response in the least squares of a model with more responses than drives, usually 1 over the
        target's RMS. At least as many as drives must be above 0; responses of weight 0 are monitored.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the identification, required by the secant update and a cautious inverse.
    caution : float, optional
        Share of the uncertainty in the first inverse, 0 or more: the inverse has less gain where the FRF is doubtful.
        0 is the plain pseudo-inverse.
    regularisation : float, optional
        Regularisation of the first inverse, relative to the median of `tr(ĤᴴĤ) / n_u`, 0 or more.
    static_gain : array_like, shape (n_y, n_u), optional
        Measured gain at 0 Hz, response unit per drive unit, finite. The model then begins at 0 Hz: lines between 0 Hz
        and the identified band are interpolated linearly, with the uncertainty of the band's first line.

    Returns
    -------
    RigModel
        Model at the start of a campaign.

    Raises
    ------
    ValueError
        Shapes that do not fit, fewer responses than drives, too few lines in the band, or a line in it with an FRF
        that cannot be inverted.
    """
    estimate = np.asarray(frf, dtype=np.complex128)
    lines = np.asarray(frequency, dtype=np.float64)
    if lines.shape != estimate.shape[:1]:
        raise ValueError(
            f"The model's FRF has the shape {estimate.shape} and its frequencies {lines.shape}; both need one value "
            "for each line."
        )
    lowest, highest = identified_band
    inside = band_mask(lines, lowest, highest, edge=0.0)
    if static_gain is not None and inside.any():
        estimate, uncertainty = _from_static_gain(
            estimate, np.asarray(static_gain, dtype=np.float64), uncertainty, first=int(np.argmax(inside))
        )
        lowest, inside = 0.0, band_mask(lines, 0.0, highest, edge=0.0)
    held = np.flatnonzero(inside)
    if held.size < FEWEST_LINES:
        raise ValueError(
            f"The identified band of {lowest:g} to {highest:g} Hz holds {held.size} lines of the model; at least "
            f"{FEWEST_LINES} are needed: take longer blocks or a wider band."
        )
    # Outside the band the estimate has no meaning, and may be NaN.
    known = inside.reshape(-1, *(1,) * (estimate.ndim - 1)) > 0.0
    matrix = as_frf(np.where(known, estimate, 0.0))
    weight = np.ones(matrix.shape[1]) if response_weight is None else np.asarray(response_weight, dtype=np.float64)
    if matrix.shape[1] < matrix.shape[2]:
        raise ValueError(
            f"The FRF has {matrix.shape[1]} responses and {matrix.shape[2]} drives; it needs at least as many "
            "responses as drives."
        )
    inverse = weighted_inverse(matrix, mask=inside, frequency=lines, response_weight=weight)
    if caution != 0.0 or regularisation != 0.0:
        inverse[held] = _first_cautious_inverse(
            matrix[held], held, weight=weight, uncertainty=uncertainty, caution=caution, regularisation=regularisation
        )
    return RigModel(
        frequency=lines,
        frf=matrix,
        inverse_frf=inverse,
        identified=slice(int(held[0]), int(held[-1]) + 1),
        response_weight=None if response_weight is None else weight,
        uncertainty=uncertainty,
    )


def _from_static_gain(
    frf: NDArray[np.complex128],
    static_gain: NDArray[np.float64],
    uncertainty: ModelUncertainty | None,
    *,
    first: int,
) -> tuple[NDArray[np.complex128], ModelUncertainty | None]:
    """Return FRF and uncertainty from 0 Hz; `first` is the first identified line."""
    if static_gain.shape != frf.shape[1:] or not np.isfinite(static_gain).all():
        raise ValueError(
            f"The static gain has the shape {static_gain.shape}; it must be {frf.shape[1:]} like a line of the FRF, "
            "and finite."
        )
    share = (np.arange(first) / max(first, 1))[:, None, None]
    whole = frf.copy()
    whole[:first] = (1.0 - share) * static_gain + share * frf[first]
    if first == 0:
        whole[0] = static_gain
    if uncertainty is None:
        return whole, None
    residual, covariance = uncertainty.residual_psd.copy(), uncertainty.row_covariance.copy()
    residual[:first], covariance[:first] = residual[first], covariance[first]
    return whole, ModelUncertainty(residual_psd=residual, row_covariance=covariance)


def _first_cautious_inverse(
    frf: NDArray[np.complex128],
    lines: NDArray[np.intp],
    *,
    weight: NDArray[np.float64],
    uncertainty: ModelUncertainty | None,
    caution: float,
    regularisation: float,
) -> NDArray[np.complex128]:
    if caution != 0.0 and uncertainty is None:
        raise ValueError(f"The caution is {caution:g} and the model's uncertainty is not given; give it or ask for 0.")
    if not 0.0 <= caution < np.inf:
        raise ValueError(f"The caution is {caution:g}; it must be finite and 0 or more.")
    # A drive is scaled by its effect on the responses, so that units do not count.
    scale = 1.0 / np.sqrt(np.mean(np.sum(np.abs(frf * weight[:, None]) ** 2, axis=1), axis=0))
    doubt = np.zeros((lines.size, scale.size, scale.size), dtype=np.complex128)
    if uncertainty is not None:
        spread = uncertainty.row_covariance[lines].conj() * scale[:, None] * scale
        doubt = caution * (uncertainty.residual_psd[lines] @ weight**2)[:, None, None] * spread
    return cautious_inverse(
        frf, uncertainty=doubt, regularisation=regularisation, response_weight=weight, drive_scale=scale
    )


def driven_lines(model: RigModel, band: ControlBand) -> NDArray[np.intp]:
    """Return the identified lines at which drives have energy.

    `model`: Model with the lines. `band`: Band of the drives' energy.
    Returns: Indices of lines, rising, shape (driven,).
    """
    inside = np.zeros(model.frequency.size, dtype=bool)
    inside[model.identified] = True
    return np.flatnonzero(inside & (band.drive_mask(model.frequency) > 0.0))
