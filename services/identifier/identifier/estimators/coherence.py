"""Multiple coherence: the share of each response's power that the drives explain."""

import numpy as np
from numpy.typing import NDArray


def multiple_coherence(
    h1: NDArray[np.complex128], s_yu: NDArray[np.complex128], auto_y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the multiple coherence of each response with all drives, ``S_yu S_uu^-1 S_uy / S_yy``.

    It is also high for dependent drives: check the condition number first.

    Source: Bendat & Piersol, *Random Data*, section 7.3.
    """
    explained = np.einsum("fij,fij->fi", h1, s_yu.conj()).real
    # It is in [0, 1] except for rounding; a coherence of 1.0000000000000002 must not be sent over the bus.
    return np.clip(explained / auto_y, 0.0, 1.0)


def require_audible(auto_y: NDArray[np.float64], frequency: NDArray[np.float64]) -> None:
    """Refuse a response without power at a line."""
    silent = np.argwhere(auto_y <= 0.0)
    if silent.size:
        line, channel = silent[0]
        raise ValueError(
            f"Response {channel} is silent at {frequency[line]:.4g} Hz, so nothing can be identified from it; "
            "check its sensor or leave it out."
        )
