"""The explicit Runge-Kutta methods of the player's loop: tableaus, and what a step does to a motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

Rational = Fraction | int


@dataclass(frozen=True)
class Tableau:
    """What a method takes from which stage (Butcher's tableau).

    `order`: The power of the step with which its error falls. `nodes`: Where in the step each stage lies, 0 to 1.
    `stages`: For each stage after the first, the shares of the slopes before it. `weights`: The shares of all slopes in
    the step.
    """

    order: int
    nodes: tuple[Rational, ...]
    stages: tuple[tuple[Rational, ...], ...]
    weights: tuple[Rational, ...]

    def growth(self) -> tuple[Fraction, ...]:
        """Return the polynomial, lowest power first, of rate times step by which a step multiplies a linear motion.

        Its coefficients are 1, then b'A^(k-1)1; up to the order they are those of the exponential. Butcher, Numerical
        Methods for Ordinary Differential Equations, section 238.
        """
        rows = ((), *self.stages)
        reached = [Fraction(1)] * len(rows)
        coefficients = [Fraction(1)]
        for _ in rows:
            coefficients.append(sum((b * r for b, r in zip(self.weights, reached, strict=True)), Fraction(0)))
            reached = [sum((a * r for a, r in zip(row, reached, strict=False)), Fraction(0)) for row in rows]
        return tuple(coefficients)


class Method(Enum):
    """How a fixed step is taken."""

    #: The classical one: 4 evaluations a step.
    RUNGE_KUTTA_4 = "runge_kutta_4"
    #: Verner's of order 6, 7 evaluations: with steps twice as long as the classical one's it is cheaper, stable
    #: further and more exact, where the drive's kinks at the samples are what a step must not straddle.
    VERNER_6 = "verner_6"

    @property
    def tableau(self) -> Tableau:
        """Its coefficients."""
        return _TABLEAUS[self]


def amplification(z: np.ndarray, method: Method) -> np.ndarray:
    """Return by how much one step multiplies a motion."""
    total: np.ndarray[Any, Any] = np.zeros_like(z)
    for coefficient in reversed(_growth(method)):
        total = total * z + coefficient
    return np.abs(total)


@cache
def _growth(method: Method) -> tuple[float, ...]:
    """Return the polynomial of a method in doubles: exact fractions are dear, and a search asks a hundred times."""
    return tuple(float(coefficient) for coefficient in method.tableau.growth())


_F = Fraction
_TABLEAUS = {
    Method.RUNGE_KUTTA_4: Tableau(
        order=4,
        nodes=(0, _F(1, 2), _F(1, 2), 1),
        stages=((_F(1, 2),), (0, _F(1, 2)), (0, 0, 1)),
        weights=(_F(1, 6), _F(1, 3), _F(1, 3), _F(1, 6)),
    ),
    # Verner, Explicit Runge-Kutta Methods with Estimates of the Local Truncation Error, SIAM J. Numer. Anal. 15 (1978),
    # the pair of orders 6 and 5 known as DVERK. Its sixth stage serves the estimate of the error alone: left out.
    Method.VERNER_6: Tableau(
        order=6,
        nodes=(0, _F(1, 6), _F(4, 15), _F(2, 3), _F(5, 6), _F(1, 15), 1),
        stages=(
            (_F(1, 6),),
            (_F(4, 75), _F(16, 75)),
            (_F(5, 6), _F(-8, 3), _F(5, 2)),
            (_F(-165, 64), _F(55, 6), _F(-425, 64), _F(85, 96)),
            (_F(-8263, 15000), _F(124, 75), _F(-643, 680), _F(-81, 250), _F(2484, 10625)),
            (
                _F(3501, 1720),
                _F(-300, 43),
                _F(297275, 52632),
                _F(-319, 2322),
                _F(24068, 84065),
                _F(3850, 26703),
            ),
        ),
        weights=(_F(3, 40), 0, _F(875, 2244), _F(23, 72), _F(264, 1955), _F(125, 11592), _F(43, 616)),
    ),
}
