"""Nonlinear terms of the drives, which an update can learn in addition to the linear model."""

from __future__ import annotations

from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Speed over its RMS below which the root of a speed is nearly straight: at zero a root has no slope.
_ROUNDING: Final = 0.05


class DriveTerm(Enum):
    """Function of one drive that its response may follow in addition to the drive itself."""

    SQUARE = "u²"
    """For arcs of levers, and springs that are stiffer in one direction."""
    CUBE = "u³"
    """For springs that get stiffer or softer in both directions."""
    SIGNED_SQUARE = "u|u|"
    """For flow through an orifice, and friction that yields."""
    SPEED = "|u̇|"
    """For dampers that differ between bump and rebound."""
    SIGNED_ROOT_OF_SPEED = "sign(u̇)√|u̇|"
    """For friction, and dampers that are stiffer at low speeds."""

    @property
    def degree(self) -> float:
        """Power of the drive's unit in the term."""
        match self:
            case DriveTerm.CUBE:
                return 3.0
            case DriveTerm.SPEED:
                return 1.0
            case DriveTerm.SIGNED_ROOT_OF_SPEED:
                return 0.5
            case _:
                return 2.0

    @property
    def is_of_speed(self) -> bool:
        """Whether the argument is the speed of the drive, and not the drive."""
        return self in SPEED_TERMS

    def argument(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the term is a function of: drives, or their speeds in drive units a sample."""
        return np.asarray(np.gradient(drive, axis=1)) if self.is_of_speed else drive

    def values(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the term of each sample of drives, drive unit to the power of its degree."""
        return self.of(self.argument(drive))

    def of(self, argument: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the term of each sample of its argument."""
        match self:
            case DriveTerm.SQUARE:
                return np.square(argument)
            case DriveTerm.CUBE:
                return argument * np.square(argument)
            case DriveTerm.SIGNED_SQUARE:
                return argument * np.abs(argument)
            case DriveTerm.SPEED:
                return np.abs(argument)
            case DriveTerm.SIGNED_ROOT_OF_SPEED:
                return argument / np.sqrt(np.sqrt(_rounded_square(argument)))

    def slopes(self, argument: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivative of the term by its argument at each sample; 0 for a speed of 0 throughout."""
        match self:
            case DriveTerm.SQUARE:
                return 2.0 * argument
            case DriveTerm.CUBE:
                return 3.0 * np.square(argument)
            case DriveTerm.SIGNED_SQUARE:
                return 2.0 * np.abs(argument)
            case DriveTerm.SPEED:
                return np.sign(argument)
            case DriveTerm.SIGNED_ROOT_OF_SPEED:
                rounded = _rounded_square(argument)
                slope = (1.0 - 0.5 * np.square(argument) / rounded) / np.sqrt(np.sqrt(rounded))
                return np.where(np.any(argument != 0.0, axis=1, keepdims=True), slope, 0.0)


ODD_TERMS = (DriveTerm.CUBE, DriveTerm.SIGNED_SQUARE)
"""Terms of the drives that change sign with them."""
SPEED_TERMS = (DriveTerm.SPEED, DriveTerm.SIGNED_ROOT_OF_SPEED)
"""Terms of the drives' speeds."""


def speed_of_lines(frequency: NDArray[np.float64], *, sample_rate: float) -> NDArray[np.complex128]:
    """Return the FRF from drives to their speeds in drive units a sample, as differences over two samples."""
    return np.asarray(1j * np.sin(2.0 * np.pi * frequency / sample_rate))


def _rounded_square(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return squares of speeds plus a small share of their mean, so that a root has a slope at zero."""
    square = np.square(speed)
    rounded = square + _ROUNDING**2 * np.mean(square, axis=1, keepdims=True)
    return np.maximum(rounded, np.finfo(np.float64).tiny)
