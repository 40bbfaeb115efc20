"""What the steps between playbacks say about the rig: the identified FRF matrix, bent to explain them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.step_spectra import StepSpectra

# A fit that leaves less than this share of what H_0 does not explain contradicts H_0, and the prior is weakened for it.
_CONTRADICTED: Final = 0.3
# Of the prior strength asked for: it never gets weaker than that, whatever the steps say.
_WEAKEST_PRIOR: Final = 0.1
# Share of the responses' energy below which a residual is rounding.
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class SecantFit:
    """The fitted FRF matrix and how little is known of it.

    Parameters
    ----------
    frf : ndarray, shape (lines, n_y, n_u)
        `H_k`, response unit per drive unit.
    uncertainty : ndarray, shape (lines, n_u, n_u)
        `E[δᴴδ] = n σ² P / N` of weighted responses and scaled drives, `N` the independent averages.
    """

    frf: NDArray[np.complex128]
    uncertainty: NDArray[np.complex128]


def fit_secant(
    spectra: StepSpectra,
    identified_frf: NDArray[np.complex128],
    *,
    identification_drive: NDArray[np.complex128],
    prior_strength: float,
    response_weight: NDArray[np.float64],
    drive_scale: NDArray[np.float64],
    averages: float,
) -> SecantFit:
    """Fit `H_k = (S̄_ΔyΔu + H_0 Λ) P`, `P⁻¹ = S̄_ΔuΔu + Λ`, anchored at the identified `H_0` by the prior `Λ`.

    It is written as `H_0 + (S̄_ΔyΔu - H_0 S̄_ΔuΔu) P`, so that steps which `H_0` explains leave it as it is. Lines
    without any drive keep `H_0`.

    A fixed prior keeps `κ / (1 + κ)` of an error of `H_0` for ever: a quarter of a wrong sign or of a delay by half a
    period, and the iteration crawls. Where the fit explains the steps far better than `H_0`, the prior is therefore
    weakened, down to a tenth; distortion and noise, which no FRF explains, leave it as it is.

    Parameters
    ----------
    spectra : StepSpectra
        From `averaged_steps`.
    identified_frf : ndarray, shape (lines, n_y, n_u)
        `H_0`.
    identification_drive : ndarray, shape (lines, n_u, n_u)
        `S_id`, the drives' spectrum in the identification up to a factor, positive definite.
    prior_strength : float
        `κ`: the prior's share of the steps' energy, greater than 0; as much where the steps do not contradict `H_0`.
    response_weight : ndarray, shape (n_y,)
        0 or more; watched responses of weight 0 are fitted but do not count as residual.
    drive_scale : ndarray, shape (n_u,)
        Drive units that count alike, greater than 0.
    averages : float
        Independent averages in the spectra of one step, 1 or more: distortion that no FRF explains averages out.

    Returns
    -------
    SecantFit
        At the same lines.

    Raises
    ------
    ValueError
        The identification's drives do not excite a line in every direction.
    """
    inverse_scale = 1.0 / drive_scale
    s_uu = spectra.drive * inverse_scale[:, None] * inverse_scale
    s_id = identification_drive * inverse_scale[:, None] * inverse_scale
    s_yu = spectra.response_with_drive * inverse_scale
    frf = identified_frf * drive_scale
    weight = response_weight**2
    discrepancy = s_yu - np.matmul(frf, s_uu)

    def unexplained(by: NDArray[np.complex128]) -> NDArray[np.float64]:
        explained = 2.0 * np.einsum("fij,fij->fi", by.conj(), s_yu).real
        modelled = np.einsum("fij,fij->fi", np.matmul(by, s_uu), by.conj()).real
        return np.maximum((spectra.response - explained + modelled) @ weight, 0.0)

    by_identified = unexplained(frf)
    known = by_identified > _ROUNDING * (spectra.response @ weight)
    # Judged by the fit with the weakest prior: a strong one hides how well another FRF would explain the steps.
    free = _spread(s_uu, s_id, np.full(by_identified.size, prior_strength * _WEAKEST_PRIOR))
    left = np.ones_like(by_identified)
    np.divide(unexplained(frf + np.matmul(discrepancy, free)), by_identified, out=left, where=known)
    spread = _spread(s_uu, s_id, prior_strength * np.clip(left / _CONTRADICTED, _WEAKEST_PRIOR, 1.0))
    fitted = frf + np.matmul(discrepancy, spread)
    moved = np.einsum("fii->f", s_uu).real > 0.0
    return SecantFit(
        frf=fitted / drive_scale,
        uncertainty=np.where(moved[:, None, None], (unexplained(fitted) / averages)[:, None, None] * spread, 0.0),
    )


def _spread(
    s_uu: NDArray[np.complex128], s_id: NDArray[np.complex128], strength: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """`P = (S̄_ΔuΔu + Λ)⁻¹`; the inverse of `S_id` at lines without any drive."""
    energy, reference = (np.einsum("fii->f", matrix).real for matrix in (s_uu, s_id))
    moved = energy > 0.0
    share = np.divide(strength * energy, reference, out=np.ones_like(energy), where=moved & (reference > 0.0))
    # The factor keeps the inversion at the size of 1, whatever the units.
    factor = np.where(moved, energy, reference)
    try:
        return np.linalg.inv((s_uu + share[:, None, None] * s_id) / factor[:, None, None]) / factor[:, None, None]
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "The identification's drives leave a direction at a line of the control band without energy; identify with "
            "as many independent experiments as drives."
        ) from error
