"""Independence of the drives: the condition of ``S_uu``, which the coherence does not show."""

import numpy as np
from numpy.typing import NDArray

LARGEST_CONDITION = 1e3
"""Condition number of the scaled S_uu above which drives count as correlated: two drives of coherence 0.996."""


def unit_diagonal(
    s_uu: NDArray[np.complex128], frequency: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Return the scale of the drives and their cross-spectrum without units."""
    power = np.einsum("fjj->fj", s_uu).real
    silent = np.argwhere(power <= 0.0)
    if silent.size:
        line, channel = silent[0]
        raise ValueError(
            f"Drive {channel} is silent at {frequency[line]:.4g} Hz, so S_uu is singular there; "
            "excite every drive in the whole band."
        )
    scale = np.sqrt(power)
    return scale, s_uu / (scale[:, :, None] * scale[:, None, :])


def drive_condition(scaled: NDArray[np.complex128], frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the condition number of the drives' cross-spectrum at each line; dependent drives are refused."""
    eigenvalues = np.linalg.eigvalsh(scaled)
    positive = eigenvalues[:, 0] > 0.0
    condition = np.divide(eigenvalues[:, -1], eigenvalues[:, 0], out=np.full(frequency.shape, np.inf), where=positive)
    worst = int(np.argmax(condition))
    if condition[worst] > LARGEST_CONDITION:
        raise ValueError(
            f"The drives' cross-spectrum is singular at {frequency[worst]:.4g} Hz: its condition number is "
            f"{condition[worst]:.3g}, at most {LARGEST_CONDITION:g} is allowed; {_most_alike(scaled[worst])}; take "
            "drives that are independent of each other, and more blocks than drives."
        )
    return condition


def _most_alike(scaled: NDArray[np.complex128]) -> str:
    likeness = np.abs(scaled) ** 2
    np.fill_diagonal(likeness, 0.0)
    first, second = sorted(int(index) for index in np.unravel_index(int(np.argmax(likeness)), likeness.shape))
    return f"drives {first} and {second} are most alike, with a coherence of {likeness[first, second]:.6g}"
