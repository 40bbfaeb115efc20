"""Mathematics for models that run both traced and plain.

Every function takes expressions, floats or float arrays: one expression among the arguments traces the operation;
plain floats go to the C library; arrays go to numpy. Compiled code has the functions written out
(:mod:`rig_sim.compile.expansion`), equal to a few units in the last place, and without the sign of a zero.
"""

from typing import Any

import numpy as np

from rig_sim.compile.operations import ARRAY_FUNCTIONS, SCALAR_FUNCTIONS, Operation
from rig_sim.compile.tracing import Expression, Scalar


def _evaluate(operation: Operation, *arguments: Scalar) -> Any:
    for argument in arguments:
        if isinstance(argument, Expression):
            return argument.graph.apply(operation, *arguments)
    if any(isinstance(argument, np.ndarray) for argument in arguments):
        return ARRAY_FUNCTIONS[operation](*arguments)
    return SCALAR_FUNCTIONS[operation](*arguments)


def sqrt(x: Scalar) -> Any:
    """Return the square root."""
    return _evaluate(Operation.SQRT, x)


def sin(x: Scalar) -> Any:
    """Return the sine of an angle [rad]."""
    return _evaluate(Operation.SIN, x)


def cos(x: Scalar) -> Any:
    """Return the cosine of an angle [rad]."""
    return _evaluate(Operation.COS, x)


def tanh(x: Scalar) -> Any:
    """Return the hyperbolic tangent."""
    return _evaluate(Operation.TANH, x)


def exp(x: Scalar) -> Any:
    """Return e to the power x."""
    return _evaluate(Operation.EXP, x)


def asin(x: Scalar) -> Any:
    """Return the angle [rad], -π/2 to π/2, whose sine is x, -1 to 1."""
    return _evaluate(Operation.ASIN, x)


def atan2(y: Scalar, x: Scalar) -> Any:
    """Return the angle [rad], -π to π, of the point (x, y)."""
    return _evaluate(Operation.ATAN2, y, x)


def absolute(x: Scalar) -> Any:
    """Return the magnitude (also ``abs(x)``)."""
    return _evaluate(Operation.ABS, x)


def minimum(a: Scalar, b: Scalar) -> Any:
    """Return the smaller value; NaN when one of them is NaN."""
    return _evaluate(Operation.MINIMUM, a, b)


def maximum(a: Scalar, b: Scalar) -> Any:
    """Return the larger value; NaN when one of them is NaN."""
    return _evaluate(Operation.MAXIMUM, a, b)


def select_positive(condition: Scalar, positive: Scalar, negative: Scalar) -> Any:
    """Return ``positive`` where ``condition >= 0`` (also for -0.0), else ``negative`` (also for NaN).

    Both are always evaluated: guard a square root by ``sqrt(maximum(x, 0.0))``, not by this selection.
    """
    return _evaluate(Operation.SELECT_POSITIVE, condition, positive, negative)


def clamp(x: Scalar, lowest: Scalar, highest: Scalar) -> Any:
    """Return x limited to ``lowest`` … ``highest``; NaN stays NaN."""
    return minimum(maximum(x, lowest), highest)
