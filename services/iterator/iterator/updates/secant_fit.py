"""Fit of the identified FRF matrix to the steps between playbacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import smooth_lines
from iterator.model import StepSpectra
from iterator.updates.anchored_fit import AnchoredSteps

PRIOR_OF_TERM: Final = 0.03
"""Prior strength of a nonlinear term of the drives."""
# Terms are noise if they leave more than the first share of the energy that the drives alone leave of a response; they
# are used fully if they leave less than the second. Random plants converge equally with 0.6 and 0.2.
_NOT_TRUSTED, _TRUSTED = 0.8, 0.4
# Factor of the independent averages by the smoothing over lines with [1 2 3 2 1] / 9: lines under a Hann window
# are correlated with their neighbours.
_AVERAGES_BY_SMOOTHING: Final = 2.4
# Share of a response's energy below which a residual is rounding.
_ROUNDING: Final = 1e-12


MatrixAndSpread = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Matrix fitted to inputs in scaled units, shape (lines, n_y, inputs), and `P`, shape (lines, inputs, inputs)."""


@dataclass(frozen=True)
class SecantFit:
    """Fitted FRF matrix and its uncertainty.

    `frf`, shape (lines, n_y, n_u): `H_k`, response unit per drive unit. `term_frf`, shape (lines, n_y, further inputs):
    FRF of the nonlinear terms, response unit per term unit. `uncertainty`, shape (lines, inputs, inputs):
    `E[δᴴδ] = n σ² P / N` of weighted responses and scaled drives, `N` the independent averages; the terms follow the
    drives and are not scaled. `of_drives`: Fit of the drives alone, scaled, and its `P`.
    """

    frf: NDArray[np.complex128]
    term_frf: NDArray[np.complex128]
    uncertainty: NDArray[np.complex128]
    of_drives: MatrixAndSpread


def fit_secant(
    spectra: StepSpectra,
    identified_frf: NDArray[np.complex128],
    *,
    identification_drive: NDArray[np.complex128],
    prior_strength: float,
    response_weight: NDArray[np.float64],
    drive_scale: NDArray[np.float64],
    averages: float,
    further_prior: float | NDArray[np.float64] = PRIOR_OF_TERM,
    of_drives: MatrixAndSpread | None = None,
) -> SecantFit:
    """Fit `H_k = (S̄_ΔyΔu + H_0 Λ) P`, `P⁻¹ = S̄_ΔuΔu + Λ`, anchored at the identified `H_0` by the prior `Λ`.

    It is written as `H_0 + (S̄_ΔyΔu - H_0 S̄_ΔuΔu) P`, so that steps explained by `H_0` do not change it. Lines without
    any drive keep `H_0`.

    A fixed prior always keeps `κ / (1 + κ)` of an error of `H_0`: a quarter of a wrong sign or of a delay by half a
    period, which makes the iteration slow. If the fit explains the steps far better than `H_0`, the prior is therefore
    weakened, down to a tenth; distortion and noise, which no FRF explains, do not weaken it.

    If the steps hold nonlinear terms of the drives, both fits are made, with and without. At each line and for each
    response the terms are weighted by how much less they leave unexplained than as many inputs of noise would.

    `further_prior`, shape () or (further inputs,): About the share of a term's effect that is withheld; the more terms
    resemble each other, the larger it has to be. `of_drives`: Fit of the drives alone if it was made before, of the
    same spectra with the same prior.
    """
    n_u, inputs = drive_scale.size, spectra.drive.shape[1]
    inverse_scale = np.concatenate((1.0 / drive_scale, np.ones(inputs - n_u)))
    steps = AnchoredSteps(
        inputs=spectra.drive * inverse_scale[:, None] * inverse_scale,
        responses_with_inputs=spectra.response_with_drive * inverse_scale,
        responses=spectra.response,
        weight=response_weight**2,
        anchor=identified_frf * drive_scale,
        prior=identification_drive / drive_scale[:, None] / drive_scale,
        further_prior=np.broadcast_to(further_prior, inputs - n_u),
    )
    alone = of_drives or steps.of_drives_alone().fit(prior_strength)
    fitted, spread = _fit_and_spread(steps, prior_strength, alone, averages=averages)
    moved = np.einsum("fii->f", steps.inputs[:, :n_u, :n_u]).real > 0.0
    residual = (steps.unexplained(fitted) @ steps.weight) / averages
    return SecantFit(
        frf=np.ascontiguousarray(fitted[:, :, :n_u] / drive_scale),
        term_frf=np.ascontiguousarray(fitted[:, :, n_u:]),
        uncertainty=np.where(moved[:, None, None], residual[:, None, None] * spread, 0.0),
        of_drives=alone,
    )


def _fit_and_spread(
    steps: AnchoredSteps, prior_strength: float, of_drives_alone: MatrixAndSpread, *, averages: float
) -> MatrixAndSpread:
    """Return the matrix of all inputs and `P`, from both fits weighted by their trust."""
    n_u, inputs = steps.drives, steps.inputs.shape[1]
    alone, spread = of_drives_alone
    if inputs == n_u:
        return alone, spread
    plain = np.concatenate((alone, np.zeros((*alone.shape[:2], inputs - n_u), dtype=np.complex128)), axis=2)
    of_drives = np.zeros((spread.shape[0], inputs, inputs), dtype=np.complex128)
    of_drives[:, :n_u, :n_u] = spread
    independent = _AVERAGES_BY_SMOOTHING * averages
    if independent <= inputs + 1:
        return plain, of_drives
    whole, whole_spread = steps.fit(prior_strength)
    left, left_with_terms = (smooth_lines(steps.unexplained(by)) for by in (plain, whole))
    # Inputs of noise would also use their degrees of freedom.
    by_chance = (independent - inputs) / (independent - n_u)
    share = np.ones_like(left)
    known = left > _ROUNDING * smooth_lines(steps.responses)
    np.divide(left_with_terms, by_chance * left, out=share, where=known)
    trust = np.clip((_NOT_TRUSTED - share) / (_NOT_TRUSTED - _TRUSTED), 0.0, 1.0)
    overall = np.mean(trust, axis=1)[:, None, None]
    return plain + trust[:, :, None] * (whole - plain), of_drives + overall * (whole_spread - of_drives)
