"""What a mirrored model computes two at a time, as lanes of one vector, and what one at a time.

A vector stands for one expression of either side and is right whatever it pairs: the same operation on vectors of the
operands, or two numbers put side by side where operations differ. Signs, which a mirror turns, are kept apart from the
vectors and only cost something where two of them meet with different signs in a sum. What belongs to both sides is
computed once; what looks across takes the other lane. So a pair of independent sides halves the work, and a rack or a
body between them costs little.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

from rig_sim.compile.operations import LEAVES, Operation
from rig_sim.compile.scheduling import creation_order
from rig_sim.compile.tracing import Expression

Key = tuple[int, int]
Signs = tuple[float, float]
PLUS: Signs = (1.0, 1.0)
SUMS = frozenset({Operation.ADD, Operation.SUBTRACT})
#: The signs of their operands multiply to the sign of their result.
PRODUCTS = frozenset({Operation.MULTIPLY, Operation.DIVIDE})

#: Lanes are taken when they save at least this share of the operations.
_WORTHWHILE = 0.1


class Form(Enum):
    """How a vector comes about."""

    CONSTANTS = auto()
    LOAD = auto()  # two states that lie side by side
    OPERATION = auto()
    SWAP = auto()  # of the lanes of another vector
    SPLAT = auto()  # one number in both lanes
    GATHER = auto()  # two numbers


@dataclass(frozen=True)
class Vector:
    """Two expressions in one register: expression i is signs[i] times lane i.

    `expressions`: Neither is a negation. `operands`: Of an operation, in the order of lane 0; of a swap the vector
    whose lanes are exchanged. `factors`: In a sum, the signs with which the operands' expressions enter.
    """

    form: Form
    expressions: tuple[Expression, Expression]
    operands: tuple[Key, ...] = ()
    factors: tuple[Signs, ...] = ()


@dataclass
class LanePlan:
    """Vectors and single numbers that together give some results.

    `scalars`: Expressions computed one at a time, by index; not leaves, not what is a lane of a vector. `lane_of`:
    Where an expression is a lane of a computed vector.
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
        """Return vectors (by key) and single numbers (by index), operands first, near the order of creation."""
        needs = {key: set(self._vector_needs(vector)) for key, vector in self.vectors.items()}
        needs |= {index: set(self._scalar_needs(node.operands)) for index, node in self.scalars.items()}
        users: dict[Key | int, list[Key | int]] = {item: [] for item in needs}
        for item, operands in needs.items():
            for operand in operands:
                users[operand].append(item)
        waiting = {item: len(operands) for item, operands in needs.items()}
        ready = [_rank(item) for item, count in waiting.items() if count == 0]
        heapq.heapify(ready)
        done = 0
        while ready:
            item = heapq.heappop(ready)[-1]
            done += 1
            yield item
            for user in users[item]:
                waiting[user] -= 1
                if waiting[user] == 0:
                    heapq.heappush(ready, _rank(user))
        if done < len(needs):
            raise ValueError(f"{len(needs) - done} vectors of the lanes need each other; compute the model unpaired.")

    def _vector_needs(self, vector: Vector) -> list[Key | int]:
        if vector.form is Form.OPERATION or vector.form is Form.SWAP:
            return [key for key in vector.operands if self.vectors[key].form is not Form.CONSTANTS]
        if vector.form is Form.SPLAT or vector.form is Form.GATHER:
            return self._scalar_needs(vector.expressions)
        return []

    def _scalar_needs(self, operands: Sequence[Expression]) -> list[Key | int]:
        computed = [operand.index for operand in operands if operand.operation not in LEAVES]
        return [self.lane_of[index][0] if index in self.lane_of else index for index in computed]


def _rank(item: Key | int) -> tuple[int, int, Key | int]:
    return (item[0], 0, item) if isinstance(item, tuple) else (item, 1, item)


def stripped(expression: Expression) -> tuple[Expression, float]:
    """Return what is negated, and the sign."""
    sign = 1.0
    while expression.operation is Operation.NEGATE:
        expression, sign = expression.operands[0], -sign
    return expression, sign


def is_worthwhile(plan: LanePlan, results: Sequence[Expression]) -> bool:
    """Whether a plan is clearly cheaper than computing the results one at a time."""
    alone = sum(node.operation not in LEAVES for node in creation_order(results))
    return plan.cost() <= (1.0 - _WORTHWHILE) * alone
