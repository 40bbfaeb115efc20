"""Operations of a traced model, and their functions on plain numbers.

Functions of Python floats are for constant folding and plain evaluation, of numpy arrays for many points at once.
"""

import math
import operator
import struct
from collections.abc import Callable
from enum import Enum
from fractions import Fraction
from typing import Any

import numpy as np


class Operation(Enum):
    """Operation of a node on its operands."""

    CONSTANT = "constant"
    INPUT = "input"
    ADD = "add"
    SUBTRACT = "subtract"
    MULTIPLY = "multiply"
    DIVIDE = "divide"
    NEGATE = "negate"
    ABS = "abs"
    SQRT = "sqrt"
    INVERSE_SQRT = "inverse_sqrt"
    SIN = "sin"
    COS = "cos"
    TANH = "tanh"
    EXP = "exp"
    ASIN = "asin"
    ATAN2 = "atan2"
    MINIMUM = "minimum"
    MAXIMUM = "maximum"
    SELECT_POSITIVE = "select_positive"
    # Only in written-out transcendental functions: a model cannot name them.
    FLOOR = "floor"
    FUSED = "fused"
    POWER_OF_TWO = "power_of_two"
    INVERSE_SQRT_ESTIMATE = "inverse_sqrt_estimate"

    # By identity, as members compare: tracing a model needs hundreds of thousands of look-ups, and an enumeration's own
    # hash is a call in Python.
    __hash__ = object.__hash__


LEAVES = frozenset({Operation.CONSTANT, Operation.INPUT})
COMMUTATIVE = frozenset({Operation.ADD, Operation.MULTIPLY, Operation.MINIMUM, Operation.MAXIMUM})
ODD = frozenset({Operation.SIN, Operation.TANH, Operation.ASIN})
EVEN = frozenset({Operation.COS})
NEVER_NEGATIVE = frozenset({Operation.ABS, Operation.SQRT, Operation.INVERSE_SQRT, Operation.EXP})


def _minimum(a: float, b: float) -> float:
    return a if a < b or math.isnan(a) else b


def _maximum(a: float, b: float) -> float:
    return a if a > b or math.isnan(a) else b


#: Bits of an estimate of the inverse square root: this less half the bits of the number (Lomont, Fast Inverse Square
#: Root, 2003, for doubles). The logarithm of a number is nearly linear in its bits.
INVERSE_SQRT_BITS = 0x5FE6EB50C7B537A9


def _inverse_sqrt_estimate(a: float) -> float:
    (bits,) = struct.unpack("<q", struct.pack("<d", a))
    (estimate,) = struct.unpack("<d", struct.pack("<q", INVERSE_SQRT_BITS - (bits >> 1)))
    return float(estimate)


_SELECT = (
    lambda condition, a, b: a if condition >= 0.0 else b,
    lambda condition, a, b: np.where(np.greater_equal(condition, 0.0), a, b),
)
_FUNCTIONS: dict[Operation, tuple[Callable[..., Any], Callable[..., Any]]] = {
    Operation.ADD: (operator.add, np.add),
    Operation.SUBTRACT: (operator.sub, np.subtract),
    Operation.MULTIPLY: (operator.mul, np.multiply),
    Operation.DIVIDE: (operator.truediv, np.divide),
    Operation.NEGATE: (operator.neg, np.negative),
    Operation.ABS: (abs, np.abs),
    Operation.SQRT: (math.sqrt, np.sqrt),
    Operation.INVERSE_SQRT: (lambda a: 1.0 / math.sqrt(a), lambda a: 1.0 / np.sqrt(a)),
    Operation.SIN: (math.sin, np.sin),
    Operation.COS: (math.cos, np.cos),
    Operation.TANH: (math.tanh, np.tanh),
    Operation.EXP: (math.exp, np.exp),
    Operation.ASIN: (math.asin, np.arcsin),
    Operation.ATAN2: (math.atan2, np.arctan2),
    Operation.MINIMUM: (_minimum, np.minimum),
    Operation.MAXIMUM: (_maximum, np.maximum),
    Operation.SELECT_POSITIVE: _SELECT,
}
ARRAY_FUNCTIONS = {operation: function for operation, (_, function) in _FUNCTIONS.items()}
SCALAR_FUNCTIONS = {operation: function for operation, (function, _) in _FUNCTIONS.items()} | {
    Operation.FLOOR: lambda a: float(math.floor(a)),
    Operation.FUSED: lambda a, b, c: float(Fraction(a) * Fraction(b) + Fraction(c)),
    Operation.POWER_OF_TWO: lambda a: math.ldexp(1.0, int(a)),
    Operation.INVERSE_SQRT_ESTIMATE: _inverse_sqrt_estimate,
}
