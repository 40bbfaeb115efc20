"""Inverses of an FRF matrix: weighted least squares, and cautious ones for an uncertain matrix."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import inverse_frf

# Rounds of alternate scaling of rows and columns (Sinkhorn): a few remove the units, more would change little.
_LEVELLING_ROUNDS: Final = 8


def weighted_inverse(
    frf: NDArray[np.complex128],
    *,
    mask: NDArray[np.float64],
    frequency: NDArray[np.float64],
    response_weight: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return the masked weighted pseudo-inverse; a response of weight 0 is monitored and has no effect on drives."""
    weight = checked_response_weight(response_weight, responses=frf.shape[1], drives=frf.shape[2])
    controlled = weight > 0.0
    matrix = np.ascontiguousarray(frf[:, controlled])
    # Weights change only the condition number of a square matrix, not its inverse: units must not cause a refusal.
    square = matrix.shape[1] == matrix.shape[2]
    row_weight = _levelling_weights(matrix[mask > 0.0]) if square else weight[controlled]
    result = np.zeros((frf.shape[0], frf.shape[2], frf.shape[1]), dtype=np.complex128)
    result[:, :, controlled] = inverse_frf(matrix, mask=mask, frequency=frequency, row_weight=row_weight)
    return result


def _levelling_weights(frf: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return weights of responses that give every row the same mean energy over the lines, with level drives."""
    power = np.mean(np.abs(frf) ** 2, axis=0)
    share = np.ones(power.shape[0])
    for _ in range(_LEVELLING_ROUNDS):
        drives = share @ power
        rows = power @ np.divide(1.0, drives, out=np.zeros_like(drives), where=drives > 0.0)
        # A row without energy is singular with any weight.
        share = np.divide(1.0, rows, out=np.ones_like(rows), where=rows > 0.0)
    return np.sqrt(share)


def checked_response_weight(
    response_weight: NDArray[np.float64], *, responses: int, drives: int
) -> NDArray[np.float64]:
    """Check the weights of responses.

    `response_weight`, shape (n_y,): 0 or more and finite. `responses`, `drives`: Numbers of the model.
    Returns: Weights, shape (n_y,).
    Raises `ValueError`: Another number of weights, a negative or infinite one, or too few above 0.
    """
    weight = np.asarray(response_weight, dtype=np.float64)
    if weight.shape != (responses,) or not np.all(np.isfinite(weight) & (weight >= 0.0)):
        raise ValueError(
            f"The response weights are {weight.tolist()}; they must be {responses} finite values of 0 or more."
        )
    controlled = int(np.count_nonzero(weight))
    if controlled < drives:
        raise ValueError(
            f"{controlled} responses have a weight above 0, for {drives} drives; control at least as many responses as "
            "there are drives."
        )
    return weight


def cautious_inverse(
    frf: NDArray[np.complex128],
    *,
    uncertainty: NDArray[np.complex128],
    regularisation: float,
    response_weight: NDArray[np.float64],
    drive_scale: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return an inverse with small gain at a doubtful FRF: `(HᴴH + E[δᴴδ] + ρ s̄ I)⁻¹ Hᴴ`, in scaled units.

    Without uncertainty and regularisation it is the weighted pseudo-inverse. With `E[δᴴδ]` beside `HᴴH` the expected
    squared error over all FRF matrices within the uncertainty is smallest.

    `frf`, shape (lines, n_y, n_u): Lines to invert only, response unit per drive unit. `uncertainty`, shape (lines,
    n_u, n_u): `E[δᴴδ]`, Hermitian, of weighted responses and scaled drives. `regularisation`: `ρ`, 0 or more; `s̄` is
    the median over lines of `tr(HᴴH) / n_u`. `response_weight`, shape (n_y,): 0 or more; 0 for monitored responses.
    `drive_scale`, shape (n_u,): Scale with which drives count equally, greater than 0: the identification's RMS.
    Returns: Inverse, shape (lines, n_u, n_y), drive unit per response unit.
    Raises `ValueError`: A negative regularisation, a line that is singular nevertheless, or an inverse that is not
    finite.
    Source: linear minimum mean square error; A. N. Tikhonov for the last term.
    """
    if not 0.0 <= regularisation < np.inf:
        raise ValueError(f"The regularisation is {regularisation:g}; it must be finite and 0 or more.")
    scaled = frf * response_weight[:, None] * drive_scale
    gram, ridge = gram_and_ridge(scaled, regularisation=regularisation)
    try:
        inverse = np.linalg.solve(gram + uncertainty + ridge, np.ascontiguousarray(scaled.conj().transpose(0, 2, 1)))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "The FRF is singular at a line and the regularisation is too small for it; raise it or narrow the band."
        ) from error
    unscaled = np.ascontiguousarray(drive_scale[:, None] * inverse * response_weight)
    if not np.isfinite(unscaled).all():
        raise ValueError(
            "The inverse of the FRF is not finite: its uncertainty, a weight or the regularisation is out of all "
            "proportion to it; look at the identification."
        )
    return unscaled


def gram_and_ridge(
    scaled: NDArray[np.complex128], *, regularisation: float
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return `HᴴH` at each line and the ridge `ρ s̄ I` that regularises it, of an FRF in scaled units."""
    n_u = scaled.shape[2]
    gram = np.matmul(np.ascontiguousarray(scaled.conj().transpose(0, 2, 1)), scaled)
    typical = float(np.median(np.einsum("fii->f", gram).real)) / n_u
    return gram, regularisation * typical * np.eye(n_u)
