"""Identities that make a traced expression simpler.

Folding is exact: it changes no finite result by a rounding (only the sign of a zero), so a graph evaluated without
fused operations gives the values of the same model run on floats. It assumes that values are finite: ``0 * x`` is 0
and ``x - x`` is 0 whatever x is, which makes the structural zeros of rotations and inertias disappear.

Negations move outwards, so that a product and its negative share the product. Constants alone are folded by the graph.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from rig_sim.compile.operations import EVEN, NEVER_NEGATIVE, ODD, Operation

if TYPE_CHECKING:
    from rig_sim.compile.tracing import Expression

_SMALLEST_DIVISOR = 2.0**-1000  # the reciprocal of a smaller power of two may overflow


def simplify(operation: Operation, operands: "tuple[Expression, ...]") -> "Expression | None":
    """Return a simpler expression that equals the operation; None when there is none.

    Parameters
    ----------
    operation : Operation
    operands : tuple of Expression
        Not all of them constants.

    Raises
    ------
    ValueError
        When the operation divides by the constant 0.
    """
    rule = _RULES.get(operation)
    return None if rule is None else rule(*operands)


def _is_negation(expression: "Expression") -> bool:
    return expression.operation is Operation.NEGATE


def _sum(a: "Expression", b: "Expression") -> "Expression | None":
    if b.value is not None:
        a, b = b, a
    if a.value is not None:
        if a.value == 0.0:
            return b
        return b - -a.value if a.value < 0.0 else None
    if _is_negation(a) and _is_negation(b):
        return -(a.operands[0] + b.operands[0])
    if _is_negation(b):
        return a - b.operands[0]
    return b - a.operands[0] if _is_negation(a) else None


def _difference(a: "Expression", b: "Expression") -> "Expression | None":
    if a is b:
        return a.graph.constant(0.0)
    if a.value == 0.0:
        return -b
    if b.value is not None and b.value <= 0.0:
        return a + -b.value
    if _is_negation(b):
        return a + b.operands[0]
    if _is_negation(a):
        return -(a.operands[0] + b)
    # b - a was traced before (the other half of a cross product): share it.
    opposite = a.graph.existing(Operation.SUBTRACT, b, a)
    return None if opposite is None else -opposite


def _product(a: "Expression", b: "Expression") -> "Expression | None":
    if b.value is not None:
        a, b = b, a
    if a.value is not None:
        if a.value == 0.0:
            return a.graph.constant(0.0)
        if a.value == 1.0:
            return b
        if a.value < 0.0:
            return -(-a.value * b)
    if _is_negation(a) and _is_negation(b):
        return a.operands[0] * b.operands[0]
    if _is_negation(a):
        return -(a.operands[0] * b)
    return -(a * b.operands[0]) if _is_negation(b) else None


def _quotient(a: "Expression", b: "Expression") -> "Expression | None":
    if b.value is not None:
        return _quotient_by_constant(a, b.value)
    if a is b or a.value == 0.0:
        return a.graph.constant(1.0 if a is b else 0.0)
    if _is_negation(a) and _is_negation(b):
        return a.operands[0] / b.operands[0]
    if _is_negation(a):
        return -(a.operands[0] / b)
    return -(a / b.operands[0]) if _is_negation(b) else None


def _quotient_by_constant(a: "Expression", divisor: float) -> "Expression | None":
    if divisor == 0.0:
        raise ValueError(f"The traced value {a!r} is divided by the constant 0; give a divisor other than 0.")
    if divisor < 0.0:
        return -(a / -divisor)
    if math.frexp(divisor)[0] == 0.5 and divisor >= _SMALLEST_DIVISOR:
        return a * (1.0 / divisor)  # exact for powers of two
    return -(a.operands[0] / divisor) if _is_negation(a) else None


def _negation(a: "Expression") -> "Expression | None":
    return a.operands[0] if _is_negation(a) else None


def _magnitude(a: "Expression") -> "Expression | None":
    if a.operation in NEVER_NEGATIVE:
        return a
    return abs(a.operands[0]) if _is_negation(a) else None


def _extreme(a: "Expression", b: "Expression") -> "Expression | None":
    return a if a is b else None


def _selection(condition: "Expression", positive: "Expression", negative: "Expression") -> "Expression | None":
    if positive is negative:
        return positive
    if condition.value is None:
        return None
    return positive if condition.value >= 0.0 else negative


def _even(operation: Operation) -> "Callable[[Expression], Expression | None]":
    return lambda a: a.graph.apply(operation, a.operands[0]) if _is_negation(a) else None


def _odd(operation: Operation) -> "Callable[[Expression], Expression | None]":
    return lambda a: -a.graph.apply(operation, a.operands[0]) if _is_negation(a) else None


_RULES: "dict[Operation, Callable[..., Expression | None]]" = {
    **{operation: _even(operation) for operation in EVEN},
    **{operation: _odd(operation) for operation in ODD},
    Operation.ADD: _sum,
    Operation.SUBTRACT: _difference,
    Operation.MULTIPLY: _product,
    Operation.DIVIDE: _quotient,
    Operation.NEGATE: _negation,
    Operation.ABS: _magnitude,
    Operation.MINIMUM: _extreme,
    Operation.MAXIMUM: _extreme,
    Operation.SELECT_POSITIVE: _selection,
}
