"""Nonlinear terms of the drives, which an update can learn beside the linear model."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray


class DriveTerm(Enum):
    """Function of one drive that its response may follow beside the drive itself."""

    SQUARE = "u²"
    """Arcs of levers, and springs that are stiffer one way."""
    CUBE = "u³"
    """Springs that get stiffer or softer both ways."""
    SIGNED_SQUARE = "u|u|"
    """Flow through an orifice, and friction that yields."""

    @property
    def degree(self) -> int:
        """Power of the drive's unit that the term has."""
        return 3 if self is DriveTerm.CUBE else 2

    def values(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the term of each sample, drive unit to the power of 2 or 3."""
        if self is DriveTerm.SQUARE:
            return np.square(drive)
        return drive * (np.square(drive) if self is DriveTerm.CUBE else np.abs(drive))

    def slopes(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivative of the term at each sample."""
        if self is DriveTerm.SQUARE:
            return 2.0 * drive
        return 3.0 * np.square(drive) if self is DriveTerm.CUBE else 2.0 * np.abs(drive)


ODD_TERMS = (DriveTerm.CUBE, DriveTerm.SIGNED_SQUARE)
"""Terms that change sign with the drive."""
