"""Inverse of an FRF matrix, line by line, in the band where it was identified."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

LARGEST_CONDITION = 1e6
"""Condition number above which a line counts as singular: no measured FRF is known to one part in a million."""


def as_frf(frf: ArrayLike, *, name: str = "frf") -> NDArray[np.complex128]:
    """Check an FRF matrix and return it as C-contiguous complex128.

    Parameters
    ----------
    frf
        FRF matrix, shape (lines, n_y, n_u), finite, of a block with an even number of samples: 2 lines or more.
    name
        Name of the matrix in an error.

    Returns
    -------
    numpy.ndarray
        FRF matrix, shape (lines, n_y, n_u); the same memory if no conversion was needed.

    Raises
    ------
    ValueError
        If the shape is wrong or a value is not finite.
    """
    matrix = np.ascontiguousarray(frf, dtype=np.complex128)
    if matrix.ndim != 3 or matrix.shape[0] < 2 or 0 in matrix.shape:
        raise ValueError(
            f"{name} has shape {matrix.shape}; an FRF has shape (lines, responses, drives) with 2 lines or more."
        )
    finite = np.isfinite(matrix)
    if not finite.all():
        line, row, column = np.argwhere(~finite)[0]
        raise ValueError(
            f"{name} holds {matrix[line, row, column]} at line {line}, row {row}, column {column}; "
            "every value must be finite."
        )
    return matrix


def inverse_frf(
    frf: ArrayLike,
    *,
    mask: ArrayLike,
    frequency: ArrayLike,
    row_weight: ArrayLike | None = None,
    largest_condition: float = LARGEST_CONDITION,
) -> NDArray[np.complex128]:
    """Return the masked (weighted pseudo-)inverse ``H^+`` of an FRF matrix, line by line.

    Parameters
    ----------
    frf
        Complex, shape (lines, n_y, n_u), ``n_y >= n_u``, response unit per drive unit.
    mask
        Mask, shape (lines), 0 to 1, see `band_mask`. Lines where it is 0 are not inverted and are 0 in the result; the
        others are multiplied by it.
    frequency
        Frequencies of the lines, shape (lines), in hertz; used in an error.
    row_weight
        Weight of the error of each response in the least-squares sense, shape (n_y), greater than 0, e.g. one over its
        target's RMS. It matters only for ``n_y > n_u``; 1 if omitted.
    largest_condition
        Largest condition number allowed at a line with a mask above 0, computed after the weights and with each drive's
        column scaled to unit length, so that units do not count. Greater than 1.

    Returns
    -------
    numpy.ndarray
        Inverse, complex, shape (lines, n_u, n_y), drive unit per response unit.

    Raises
    ------
    ValueError
        If a shape or value is not allowed, or a line with a mask above 0 is singular.

    Notes
    -----
    Source: the dagger of Eq. 2, Cornelis et al., ISMA 2014. Outside the identified band ``S_uu`` is singular and H1 is
    noise, which no limit on the condition number of ``H`` detects; therefore the mask.
    """
    matrix = as_frf(frf)
    lines, n_y, n_u = matrix.shape
    if n_y < n_u:
        raise ValueError(
            f"The FRF has {n_y} responses and {n_u} drives; it needs at least as many responses as drives."
        )
    weight = _checked_weight(row_weight, n_y)
    band = np.asarray(mask, dtype=np.float64)
    line_frequency = np.asarray(frequency, dtype=np.float64)
    if band.shape != (lines,) or line_frequency.shape != (lines,):
        raise ValueError(
            f"The mask has shape {band.shape} and the frequencies {line_frequency.shape}; both need one value "
            f"for each of the {lines} lines."
        )
    if not np.all((band >= 0.0) & (band <= 1.0)):
        line = int(np.flatnonzero(~((band >= 0.0) & (band <= 1.0)))[0])
        raise ValueError(f"The mask is {band[line]} at line {line}; it must lie between 0 and 1 at every line.")
    active = np.flatnonzero(band > 0.0)
    if active.size == 0:
        raise ValueError("The mask is 0 at every line; the band must hold at least one line of the FRF.")

    weighted = matrix[active] * weight[:, None]
    length = np.linalg.norm(weighted, axis=1)
    _refuse_silent_drive(length, line_frequency[active])
    left, singular, right = np.linalg.svd(weighted / length[:, None, :], full_matrices=False)
    condition = np.divide(
        singular[:, 0], singular[:, -1], out=np.full(active.size, np.inf), where=singular[:, -1] > 0.0
    )
    worst = int(np.argmax(condition))
    if condition[worst] > largest_condition:
        raise ValueError(
            f"The FRF is singular at {line_frequency[active[worst]]:.6g} Hz: its condition number is "
            f"{condition[worst]:.3g}, at most {largest_condition:.3g} can be inverted; narrow the band or identify "
            "again."
        )
    # Computed from the factors: right^H diag(1/s) left^H, then the scalings of columns and rows undone.
    core = np.matmul(right.conj().transpose(0, 2, 1) / singular[:, None, :], left.conj().transpose(0, 2, 1))
    inverse = np.zeros((lines, n_u, n_y), dtype=np.complex128)
    inverse[active] = core / length[:, :, None] * weight * band[active, None, None]
    return inverse


def pseudo_inverse(matrices: ArrayLike) -> NDArray[np.complex128]:
    """Return the pseudo-inverse of each matrix, computed with columns of unit length, so that drive units do not count.

    Without that, a column 1e15 times smaller than another one counts as rounding and is left out. No matrix is refused:
    see `inverse_frf` for an FRF with its band.
    see `inverse_frf` for an FRF with its band.

    Parameters
    ----------
    matrices
        Shape (..., rows, columns), real or complex, finite. A column of zeros leaves a row of zeros.

    Returns
    -------
    numpy.ndarray
        Pseudo-inverses, complex, shape (..., columns, rows).
    """
    values = np.asarray(matrices, dtype=np.complex128)
    length = np.linalg.norm(values, axis=-2, keepdims=True)
    size = np.where(length > 0.0, length, 1.0)
    return np.asarray(np.linalg.pinv(values / size) / np.swapaxes(size, -1, -2), dtype=np.complex128)


def _checked_weight(row_weight: ArrayLike | None, n_y: int) -> NDArray[np.float64]:
    if row_weight is None:
        return np.ones(n_y)
    weight = np.asarray(row_weight, dtype=np.float64)
    if weight.shape != (n_y,) or not np.all(np.isfinite(weight) & (weight > 0.0)):
        raise ValueError(f"The row weights are {weight.tolist()}; they must be {n_y} finite values greater than 0.")
    return weight


def _refuse_silent_drive(length: NDArray[np.float64], frequency: NDArray[np.float64]) -> None:
    silent = np.argwhere(length == 0.0)
    if silent.size:
        line, drive = silent[0]
        raise ValueError(
            f"No response moves with drive {drive} at {frequency[line]:.6g} Hz, so the FRF is singular there; "
            "narrow the band or identify again."
        )
