"""Interface of a rig's model for the drive map."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray


class FrfModel(Protocol):
    """FRF matrix of a rig and the lines at which it was identified.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Frequencies in Hz, equally spaced from 0 to half the sample rate.
    frf : ndarray, shape (lines, n_y, n_u)
        FRF matrix, response unit per drive unit, e^{+jwt}.
    identified : slice
        Lines at which `frf` is known; at least four.
    """

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Frequency of each line."""
        ...

    @property
    def frf(self) -> NDArray[np.complex128]:
        """FRF matrix at each line."""
        ...

    @property
    def identified(self) -> slice:
        """Lines at which the FRF matrix is known."""
        ...


ModelT = TypeVar("ModelT", bound=FrfModel)
