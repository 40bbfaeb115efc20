"""Nonlinear terms of the drives, which an update can learn in addition to the linear model."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray


class DriveTerm(Enum):
    """Function of one drive that its response may follow in addition to the drive itself."""

    SQUARE = "u²"
    """For arcs of levers, and springs that are stiffer in one direction."""
    CUBE = "u³"
    """For springs that get stiffer or softer in both directions."""
    SIGNED_SQUARE = "u|u|"
    """For flow through an orifice, and friction that yields."""

    @property
    def degree(self) -> int:
        """Power of the drive's unit in the term."""
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
