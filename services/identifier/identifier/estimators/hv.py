"""Hv: total least squares, for noise on drives and responses."""

import numpy as np
from numpy.typing import NDArray


def hv(
    auto_y: NDArray[np.float64],
    s_yu: NDArray[np.complex128],
    scaled_s_uu: NDArray[np.complex128],
    scale: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return the FRF matrix by Hv: each response's row from the smallest eigenvector of its spectra with the drives.

    Every channel is first divided by its own amplitude at the line, so noise is assumed to be the same share of each
    channel's power and units do not matter. For one drive its magnitude is the geometric mean of H1 and H2.

    Source: Rocklin, Crowley, Vold, "A comparison of H1, H2, and Hv frequency response functions", IMAC 1985.
    """
    lines, n_y, n_u = s_yu.shape
    amplitude = np.sqrt(auto_y)
    joint = np.empty((lines, n_y, n_u + 1, n_u + 1), dtype=np.complex128)
    cross = s_yu / (amplitude[:, :, None] * scale[:, None, :])
    joint[:, :, :n_u, :n_u] = scaled_s_uu[:, None]
    joint[:, :, n_u, :n_u] = cross
    joint[:, :, :n_u, n_u] = cross.conj()
    joint[:, :, n_u, n_u] = 1.0
    vectors: NDArray[np.complex128] = np.linalg.eigh(joint)[1].astype(np.complex128, copy=False)
    # w^H [u; y] is smallest for y = -(w_u^* / w_y^*) u.
    smallest = vectors[..., 0].conj()
    of_response = smallest[..., n_u]
    if np.any(np.abs(of_response) < np.finfo(np.float64).eps):
        line, channel = np.argwhere(np.abs(of_response) < np.finfo(np.float64).eps)[0]
        raise ValueError(
            f"Total least squares has no solution for response {channel} at line {line}: the drives are too strongly "
            "correlated; use H1."
        )
    row = -smallest[..., :n_u] / of_response[..., None]
    return row * amplitude[:, :, None] / scale[:, None, :]
