"""Conversion of the triangular factor of a local regression to the FRF, polynomial or rational.

With the columns of the drives first, the factor is ``[[R11, R12], [0, R22]]``: the part of the responses that the
drives explain is in ``R12``, the rest in ``R22``. Each response has its own denominator.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.local_regression import LocalSums

# Share of a column of unit size: a smaller rest after the projection of the drives is rounding.
_ROUNDING = 1e-11


@dataclass(frozen=True)
class LocalSolution:
    """The FRF at the excited lines, and figures of its quality.

    `frf`: Complex, shape (excited lines, responses, drives). `residual_psd`: Shape (excited lines, responses), density
    of the unexplained part, without the bias of the fit. `explained`: Share of each response's power that the fit
    explains, without its share of any noise, shape (excited lines, responses), 0 to 1. `drive_weight`: Shape (excited
    lines, drives): variance of an FRF element over the residual density, by drive. `degrees_of_freedom`: Shape (excited
    lines): complex degrees of freedom of the residual, greater than 0.
    """

    frf: NDArray[np.complex128]
    residual_psd: NDArray[np.float64]
    explained: NDArray[np.float64]
    drive_weight: NDArray[np.float64]
    degrees_of_freedom: NDArray[np.float64]


def solve_local(sums: LocalSums) -> LocalSolution:
    """Solve the local regression at every excited line."""
    n_u, n_y, poles = sums.drives, sums.responses, sums.model.denominator_order
    unknowns = sums.unknowns - poles
    freedom = degrees_of_freedom(sums, equations=sums.equations)
    _require_independent(sums, unknowns)
    size = np.linalg.norm(sums.factor, axis=1)
    of_drives = sums.factor[:, :unknowns, :unknowns] / size[:, None, :unknowns]
    explained_part = sums.factor[:, :unknowns, unknowns:]
    # Rows below the responses' columns are zero, and fewer equations than columns leave the last rows zero, too.
    rest = sums.factor[:, unknowns:, unknowns:]
    frf = np.empty((sums.lines.size, n_y, n_u), dtype=np.complex128)
    unexplained = np.empty((sums.lines.size, n_y))
    for channel in range(n_y):
        columns = channel + n_y * np.arange(poles + 1)
        denominator = _denominator(rest[:, :, columns], size[:, unknowns + columns])
        numerator = np.linalg.solve(of_drives, explained_part[:, :, columns] @ denominator)[:, :n_u, 0]
        frf[:, channel] = numerator / size[:, :n_u]
        equation_error = np.sum(np.abs(rest[:, :, columns] @ denominator) ** 2, axis=(1, 2))
        # Noise of the response is multiplied by the denominator in the equation.
        unexplained[:, channel] = equation_error / _mean_square(denominator[:, :, 0])
    total = size[:, unknowns : unknowns + n_y] ** 2
    silent = np.argwhere(total == 0.0)
    if silent.size:
        line, channel = silent[0]
        raise ValueError(f"Response {channel} is silent around excited line {line}; check its sensor or leave it out.")
    inverse = np.linalg.inv(of_drives)[:, :n_u]
    return LocalSolution(
        frf=frf,
        residual_psd=unexplained / freedom,
        # The unknowns explain their share of any noise.
        explained=np.clip(1.0 - unexplained / total * (sums.equations / freedom), 0.0, 1.0),
        drive_weight=np.sum(np.abs(inverse) ** 2, axis=2) / size[:, :n_u] ** 2,
        degrees_of_freedom=np.full(sums.lines.size, float(freedom)),
    )


def degrees_of_freedom(sums: LocalSums, *, equations: int) -> int:
    """Return the number of equations at a line minus its unknowns."""
    unknowns = sums.unknowns
    if equations <= unknowns:
        raise ValueError(
            f"The neighbourhood of a line gives {equations} equations for {unknowns} unknowns; take a larger "
            "half-width, a longer record, or more experiments."
        )
    return equations - unknowns


def _denominator(rest: NDArray[np.complex128], size: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the coefficients from ``r^0``, which is 1, shape (lines, poles + 1, 1): the smallest that explain most.

    If the FRF is a polynomial already they are not determined: poles and zeros cancel, and they are 0.
    """
    result = np.zeros((rest.shape[0], rest.shape[2], 1), dtype=np.complex128)
    result[:, 0] = 1.0
    if rest.shape[2] > 1:
        scaled = rest / np.where(size > 0.0, size, 1.0)[:, None, :]
        left, values, right = np.linalg.svd(scaled[:, :, 1:], full_matrices=False)
        inverse = np.divide(1.0, values, out=np.zeros_like(values), where=values > _ROUNDING)
        along = left.conj().transpose(0, 2, 1) @ scaled[:, :, :1]
        solved = -(right.conj().transpose(0, 2, 1) @ (inverse[:, :, None] * along))
        ratio = size[:, :1] / np.where(size[:, 1:] > 0.0, size[:, 1:], 1.0)
        result[:, 1:] = solved * ratio[:, :, None]
    return result


def _mean_square(polynomial: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the mean of ``|A(r)|^2`` over the neighbourhood, ``r`` from -1 to 1."""
    exponent = np.add.outer(np.arange(polynomial.shape[1]), np.arange(polynomial.shape[1]))
    moments = np.where(exponent % 2 == 0, 1.0 / (exponent + 1.0), 0.0)
    return np.einsum("fs,st,ft->f", polynomial, moments, polynomial.conj()).real


def _require_independent(sums: LocalSums, unknowns: int) -> None:
    drives = sums.factor[:, :unknowns, :unknowns]
    size = np.linalg.norm(drives, axis=1)
    diagonal = np.abs(np.einsum("fjj->fj", drives))
    weak = np.argwhere(diagonal <= _ROUNDING * size)
    if weak.size:
        line, column = weak[0]
        raise ValueError(
            f"Around excited line {sums.lines[line]} drive {column % sums.drives} is not separable from the others; "
            "use drives that are independent of each other, or a larger half-width."
        )
