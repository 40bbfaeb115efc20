"""The operations that a traced model may consist of, and what each computes on plain numbers.

One table for Python floats (constant folding and the plain evaluation) and one for numpy arrays (many points at once).
"""

import math
from collections.abc import Callable, Mapping
from enum import Enum
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np


class Operation(Enum):
    """What a node of a graph computes from its operands."""

    CONSTANT = "constant"
    INPUT = "input"
    ADD = "add"
    SUBTRACT = "subtract"
    MULTIPLY = "multiply"
    DIVIDE = "divide"
    NEGATE = "negate"
    ABS = "abs"
    SQRT = "sqrt"
    SIN = "sin"
    COS = "cos"
    TANH = "tanh"
    EXP = "exp"
    ASIN = "asin"
    ATAN2 = "atan2"
    MINIMUM = "minimum"
    MAXIMUM = "maximum"
    SELECT_POSITIVE = "select_positive"
    # Only in what transcendental functions are written out as: a model has no name for them.
    FLOOR = "floor"
    FUSED = "fused"
    POWER_OF_TWO = "power_of_two"

    # By identity, as members compare: a model is traced with hundreds of thousands of look-ups, and an enumeration's
    # own hash is a call in Python.
    __hash__ = object.__hash__


LEAVES = frozenset({Operation.CONSTANT, Operation.INPUT})
COMMUTATIVE = frozenset({Operation.ADD, Operation.MULTIPLY, Operation.MINIMUM, Operation.MAXIMUM})
ODD = frozenset({Operation.SIN, Operation.TANH, Operation.ASIN})
EVEN = frozenset({Operation.COS})
NEVER_NEGATIVE = frozenset({Operation.ABS, Operation.SQRT, Operation.EXP})


def _minimum(a: float, b: float) -> float:
    return a if a < b or math.isnan(a) else b


def _maximum(a: float, b: float) -> float:
    return a if a > b or math.isnan(a) else b


SCALAR_FUNCTIONS: Mapping[Operation, Callable[..., float]] = MappingProxyType(
    {
        Operation.ADD: lambda a, b: a + b,
        Operation.SUBTRACT: lambda a, b: a - b,
        Operation.MULTIPLY: lambda a, b: a * b,
        Operation.DIVIDE: lambda a, b: a / b,
        Operation.NEGATE: lambda a: -a,
        Operation.ABS: abs,
        Operation.SQRT: math.sqrt,
        Operation.SIN: math.sin,
        Operation.COS: math.cos,
        Operation.TANH: math.tanh,
        Operation.EXP: math.exp,
        Operation.ASIN: math.asin,
        Operation.ATAN2: math.atan2,
        Operation.MINIMUM: _minimum,
        Operation.MAXIMUM: _maximum,
        Operation.SELECT_POSITIVE: lambda condition, a, b: a if condition >= 0.0 else b,
        Operation.FLOOR: lambda a: float(math.floor(a)),
        Operation.FUSED: lambda a, b, c: float(Fraction(a) * Fraction(b) + Fraction(c)),
        Operation.POWER_OF_TWO: lambda a: math.ldexp(1.0, int(a)),
    }
)

ARRAY_FUNCTIONS: Mapping[Operation, Callable[..., Any]] = MappingProxyType(
    {
        Operation.ADD: np.add,
        Operation.SUBTRACT: np.subtract,
        Operation.MULTIPLY: np.multiply,
        Operation.DIVIDE: np.divide,
        Operation.NEGATE: np.negative,
        Operation.ABS: np.abs,
        Operation.SQRT: np.sqrt,
        Operation.SIN: np.sin,
        Operation.COS: np.cos,
        Operation.TANH: np.tanh,
        Operation.EXP: np.exp,
        Operation.ASIN: np.arcsin,
        Operation.ATAN2: np.arctan2,
        Operation.MINIMUM: np.minimum,
        Operation.MAXIMUM: np.maximum,
        Operation.SELECT_POSITIVE: lambda condition, a, b: np.where(np.greater_equal(condition, 0.0), a, b),
    }
)
