"""H2: the FRF matrix that is unbiased for noise on the drives."""

import numpy as np
from numpy.typing import NDArray

LARGEST_CONDITION_OF_H2 = 1e6
"""Condition number of the scaled S_uy above which H2 is refused: a plant that couples its responses may reach 1e3."""


def h2(
    s_yy: NDArray[np.complex128], s_yu: NDArray[np.complex128], frequency: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the FRF matrix by H2, ``S_yy S_uy^-1``.

    ``S_uy = S_yu^H`` is not Hermitian, so it is solved as a general matrix.
    Source: Bendat & Piersol, *Random Data*, chapter 7; method named as in Cornelis et al., ISMA 2014.
    """
    n_y, n_u = s_yu.shape[1:]
    if n_y != n_u:
        raise ValueError(
            f"There are {n_y} responses and {n_u} drives; H2 inverts S_uy and needs as many of both: take H1 or Hv."
        )
    amplitude = np.sqrt(np.einsum("fii->fi", s_yy).real)
    column = np.linalg.norm(s_yu / amplitude[:, :, None], axis=1)
    if np.any(column == 0.0):
        line, channel = np.argwhere(column == 0.0)[0]
        raise ValueError(
            f"Drive {channel} moves no response at {frequency[line]:.4g} Hz, so S_uy is singular there; take H1."
        )
    # H S_uy = S_yy, transposed; rows and columns are scaled to one size first, so that units do not matter.
    s_uy = s_yu.conj().transpose(0, 2, 1) / (column[:, :, None] * amplitude[:, None, :])
    condition = np.linalg.cond(s_uy)
    worst = int(np.argmax(condition))
    if not condition[worst] <= LARGEST_CONDITION_OF_H2:
        raise ValueError(
            f"S_uy is singular at {frequency[worst]:.4g} Hz: its condition number is {condition[worst]:.3g}, at most "
            f"{LARGEST_CONDITION_OF_H2:g} is allowed; take H1 or Hv."
        )
    right = s_yy / amplitude[:, None, :]
    solved = np.linalg.solve(s_uy.transpose(0, 2, 1), right.transpose(0, 2, 1)).transpose(0, 2, 1)
    return solved / column[:, None, :]
