"""Plan of the lanes of a mirrored model: which expressions are computed in pairs as one vector, and in which order.

A vector holds one expression of either side and is correct for any pair: the same operation on vectors of the operands,
or two numbers side by side if operations differ. Signs, which a mirror changes, are kept separate from the vectors and
only cost something if two of them with different signs meet in a sum.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

from rig_sim.compile.operations import COMMUTATIVE, LEAVES, Operation
from rig_sim.compile.symmetry import Mirror
from rig_sim.compile.tracing import Expression, creation_order

Key = tuple[int, int]
Signs = tuple[float, float]
PLUS: Signs = (1.0, 1.0)
MINUS: Signs = (-1.0, -1.0)
SUMS = frozenset({Operation.ADD, Operation.SUBTRACT})
#: Operations whose result has the product of the operands' signs.
PRODUCTS = frozenset({Operation.MULTIPLY, Operation.DIVIDE})

#: Places in the order of creation by which an item comes sooner for each cycle that others wait for it.
_URGENCY = 5.0
#: Cycles until a result is there, roughly; others take 4.
_CYCLES = {Operation.DIVIDE: 16.0, Operation.SQRT: 20.0, Operation.FLOOR: 8.0}

#: Lanes are used if they save at least this share of the operations.
_WORTHWHILE = 0.1


class Form(Enum):
    """Origin of a vector."""

    CONSTANTS = auto()
    LOAD = auto()  # two adjacent states
    OPERATION = auto()
    SWAP = auto()  # exchanged lanes of another vector
    SPLAT = auto()  # one number in both lanes
    GATHER = auto()  # two numbers


@dataclass(frozen=True)
class Vector:
    """Two expressions in one register: expression i is signs[i] times lane i.

    `expressions`: Neither is a negation. `operands`: Operands of an operation, in the order of lane 0; for a swap the
    vector whose lanes are exchanged. `factors`: In a sum, the signs of the operands' expressions.
    """

    form: Form
    expressions: tuple[Expression, Expression]
    operands: tuple[Key, ...] = ()
    factors: tuple[Signs, ...] = ()


@dataclass
class LanePlan:
    """Vectors and single numbers that together compute some results.

    `scalars`: Expressions computed one at a time, by index, without leaves and lanes of vectors. `lane_of`: Vector and
    lane of an expression that is a lane of a computed vector.
    """

    vectors: dict[Key, Vector] = field(default_factory=dict)
    signs: dict[Key, Signs] = field(default_factory=dict)
    scalars: dict[int, Expression] = field(default_factory=dict)
    lane_of: dict[int, tuple[Key, int]] = field(default_factory=dict)

    def cost(self) -> int:
        """Return the number of operations."""
        moved = {Form.SWAP: 1, Form.SPLAT: 1, Form.GATHER: 2}
        total = len(self.scalars)
        for vector in self.vectors.values():
            if vector.form is Form.OPERATION:
                total += 1
            total += moved.get(vector.form, 0)
        return total

    def order(self) -> Iterator[Key | int]:
        """Return vectors (by key) and single numbers (by index), operands first.

        It is near the order of creation, and what long chains of others wait for comes sooner.
        """
        needs = {item: set(self.needs(item)) for item in (*self.vectors, *self.scalars)}
        users: dict[Key | int, list[Key | int]] = {item: [] for item in needs}
        for item, operands in needs.items():
            for operand in operands:
                users[operand].append(item)
        delays = self._delays(needs, users)

        def rank(item: Key | int) -> tuple[float, int, int, Key | int]:
            created, kind, _ = rank_of(item)
            return (created - _URGENCY * delays.get(item, 0.0), created, kind, item)

        waiting = {item: len(operands) for item, operands in needs.items()}
        ready = [rank(item) for item, count in waiting.items() if count == 0]
        heapq.heapify(ready)
        done = 0
        while ready:
            item = heapq.heappop(ready)[-1]
            done += 1
            yield item
            for user in users[item]:
                waiting[user] -= 1
                if waiting[user] == 0:
                    heapq.heappush(ready, rank(user))
        if done < len(needs):
            raise ValueError(f"{len(needs) - done} vectors of the lanes need each other; compute the model unpaired.")

    def _delays(
        self, needs: Mapping[Key | int, set[Key | int]], users: Mapping[Key | int, Sequence[Key | int]]
    ) -> dict[Key | int, float]:
        """Return the longest chain of each item and its users, in cycles; none for items that need each other."""
        delays: dict[Key | int, float] = {}
        waiting = {item: len(others) for item, others in users.items()}
        ready = [item for item, count in waiting.items() if count == 0]
        while ready:
            item = ready.pop()
            delays[item] = self._cycles(item) + max((delays[user] for user in users[item]), default=0.0)
            for operand in needs[item]:
                waiting[operand] -= 1
                if waiting[operand] == 0:
                    ready.append(operand)
        return delays

    def _cycles(self, item: Key | int) -> float:
        if not isinstance(item, tuple):
            return _CYCLES.get(self.scalars[item].operation, 4.0)
        vector = self.vectors[item]
        return _CYCLES.get(vector.expressions[0].operation, 4.0) if vector.form is Form.OPERATION else 1.0

    def is_possible(self) -> bool:
        """Return whether no two vectors need each other: else the mirror is not usable."""
        try:
            return all(True for _ in self.order())
        except ValueError:
            return False

    def needs(self, item: Key | int) -> list[Key | int]:
        """Return the vectors and single numbers that a vector or a single number needs."""
        if not isinstance(item, tuple):
            return self._scalar_needs(self.scalars[item].operands)
        vector = self.vectors[item]
        if vector.form is Form.OPERATION or vector.form is Form.SWAP:
            return [key for key in vector.operands if self.vectors[key].form is not Form.CONSTANTS]
        if vector.form is Form.SPLAT or vector.form is Form.GATHER:
            return self._scalar_needs(vector.expressions)
        return []

    def _scalar_needs(self, operands: Sequence[Expression]) -> list[Key | int]:
        return [self.made_as(operand) for operand in operands if operand.operation not in LEAVES]

    def made_as(self, expression: Expression) -> Key | int:
        """Return the vector of which an expression is a lane, or its own index."""
        return self.lane_of[expression.index][0] if expression.index in self.lane_of else expression.index


def rank_of(item: Key | int) -> tuple[int, int, Key | int]:
    """Return the rank of a vector or a single number in the order of creation."""
    return (item[0], 0, item) if isinstance(item, tuple) else (item, 1, item)


def stripped(expression: Expression) -> tuple[Expression, float]:
    """Return the expression without negations, and its sign."""
    sign = 1.0
    while expression.operation is Operation.NEGATE:
        expression, sign = expression.operands[0], -sign
    return expression, sign


def key_of(a: Expression, b: Expression) -> Key:
    """Return the key of the vector of two expressions, whatever their signs."""
    return (stripped(a)[0].index, stripped(b)[0].index)


def is_worthwhile(plan: LanePlan, results: Sequence[Expression]) -> bool:
    """Return whether a plan is clearly cheaper than computing the results one at a time."""
    alone = sum(node.operation not in LEAVES for node in creation_order(results))
    return plan.cost() <= (1.0 - _WORTHWHILE) * alone


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
    """Return the vector of two expressions, and the matching operands of an operation."""
    both = (a, b)
    if mirror.is_constant(a) and mirror.is_constant(b):
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
    """Return the matching operands of two expressions, with their signs; None if they do not match."""
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
    """Return the signs of a vector that its users must apply, given those of its operands."""
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
    return PLUS  # the signs were applied to the operands


def times(a: Signs, b: Signs) -> Signs:
    """Multiply signs lane by lane."""
    return (a[0] * b[0], a[1] * b[1])


def _plan_scalars(plan: LanePlan, singles: Sequence[Expression]) -> None:
    """Find the expressions to be computed as single numbers: for such results, and for gathered vectors."""
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
