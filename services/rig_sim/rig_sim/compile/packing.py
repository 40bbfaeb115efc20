"""Plan the lanes of a mirrored model: from the results downwards, two expressions at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rig_sim.compile.lanes import PLUS, PRODUCTS, SUMS, Form, Key, LanePlan, Signs, Vector, stripped
from rig_sim.compile.operations import COMMUTATIVE, LEAVES, Operation
from rig_sim.compile.symmetry import Mirror
from rig_sim.compile.tracing import Expression

_Terms = list[tuple[Expression, float]]
_Matches = list[tuple[tuple[Expression, float], tuple[Expression, float]]]
_EITHER_ORDER = COMMUTATIVE | SUMS


def plan_lanes(
    mirror: Mirror,
    *,
    pairs: Sequence[tuple[Expression, Expression]],
    singles: Sequence[Expression],
    side_by_side: Iterable[Key],
) -> LanePlan:
    """Plan the computation of some results."""
    plan = LanePlan()
    loads = frozenset(side_by_side)
    stack = [(stripped(a)[0], stripped(b)[0]) for a, b in reversed(pairs)]
    while stack:
        a, b = stack.pop()
        key = (a.index, b.index)
        if key in plan.vectors:
            continue
        vector, matched = _vector(mirror, plan.vectors, a, b, loads=loads)
        plan.vectors[key] = vector
        if vector.form is Form.OPERATION:
            plan.lane_of.setdefault(a.index, (key, 0))
            plan.lane_of.setdefault(b.index, (key, 1))
            stack.extend((x, y) for (x, _), (y, _) in reversed(matched))
        elif vector.form is Form.SWAP:
            stack.append((b, a))
    for key in sorted(plan.vectors, key=lambda key: (sum(key), plan.vectors[key].form is Form.SWAP, key)):
        plan.signs[key] = _signs(plan, plan.vectors[key])
    _plan_scalars(plan, singles)
    return plan


def _vector(
    mirror: Mirror, vectors: Mapping[Key, Vector], a: Expression, b: Expression, *, loads: frozenset[Key]
) -> tuple[Vector, _Matches]:
    """Return the vector of two expressions, and how the operands of an operation go together."""
    both = (a, b)
    if a.value is not None and b.value is not None:
        return Vector(Form.CONSTANTS, both), []
    if a is b:
        return Vector(Form.SPLAT, both), []
    if (a.index, b.index) in loads:
        return Vector(Form.LOAD, both), []
    opposite = (b.index, a.index)
    if opposite in loads or (opposite in vectors and vectors[opposite].form is Form.OPERATION):
        return Vector(Form.SWAP, both, (opposite,)), []
    matched = _matched(mirror, a, b)
    if matched is None:
        return Vector(Form.GATHER, both), []
    operands = tuple((x.index, y.index) for (x, _), (y, _) in matched)
    factors = tuple((sign, other) for (_, sign), (_, other) in matched)
    return Vector(Form.OPERATION, both, operands, factors), matched


def _matched(mirror: Mirror, a: Expression, b: Expression) -> _Matches | None:
    """Return the operands of two expressions as they go together, with their signs; None when they do not."""
    if a.operation in LEAVES or mirror.first[a.index] != mirror.second[b.index]:
        return None
    if a.operation is not b.operation and not (a.operation in SUMS and b.operation in SUMS):
        return None
    left, right = _terms(a), _terms(b)
    orders = [right]
    if a.operation in _EITHER_ORDER:
        orders.append(right[::-1])
    for order in orders:
        if all(mirror.first[x.index] == mirror.second[y.index] for (x, _), (y, _) in zip(left, order, strict=True)):
            return list(zip(left, order, strict=True))
    return None


def _terms(expression: Expression) -> _Terms:
    terms = [stripped(operand) for operand in expression.operands]
    if expression.operation is Operation.SUBTRACT:
        terms[1] = (terms[1][0], -terms[1][1])
    return terms


def _signs(plan: LanePlan, vector: Vector) -> Signs:
    """Return the signs that a vector leaves to whoever uses it, given those of its operands."""
    if vector.form is Form.SWAP:
        signs = plan.signs.get(vector.operands[0], PLUS)
        return (signs[1], signs[0])
    operation = vector.expressions[0].operation
    if vector.form is not Form.OPERATION or operation is Operation.ABS:
        return PLUS
    entering = [times(plan.signs[key], factor) for key, factor in zip(vector.operands, vector.factors, strict=True)]
    if operation in PRODUCTS:
        return times(*entering)
    if operation in SUMS:
        return entering[0]
    return PLUS  # the operands are given their signs before


def times(a: Signs, b: Signs) -> Signs:
    """Multiply signs lane by lane."""
    return (a[0] * b[0], a[1] * b[1])


def _plan_scalars(plan: LanePlan, singles: Sequence[Expression]) -> None:
    """Find what has to be computed as a single number: for such results, and for what vectors gather."""
    pending = list(singles)
    for vector in plan.vectors.values():
        if vector.form is Form.SPLAT or vector.form is Form.GATHER:
            pending.extend(vector.expressions)
    while pending:
        expression = pending.pop()
        index = expression.index
        if expression.operation in LEAVES or index in plan.scalars or index in plan.lane_of:
            continue
        plan.scalars[index] = expression
        pending.extend(expression.operands)
