"""H1: the FRF matrix that leaves the least noise on the responses."""

import numpy as np
from numpy.typing import NDArray


def h1(
    s_yu: NDArray[np.complex128], scaled_s_uu: NDArray[np.complex128], scale: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the FRF matrix by H1, ``S_yu S_uu^-1``, with ``S_uu = D R D`` solved through ``R``: without drive units.

    Source: Cornelis et al., ISMA 2014, Eq. 1; Bendat & Piersol, *Random Data*, chapter 7.
    """
    solved = np.linalg.solve(scaled_s_uu.transpose(0, 2, 1), (s_yu / scale[:, None, :]).transpose(0, 2, 1))
    return np.asarray(solved.transpose(0, 2, 1) / scale[:, None, :], dtype=np.complex128)
