"""Lanes of a mirrored model: expressions computed in pairs as one vector, and others.

A vector holds one expression of either side and is correct for any pair: the same operation on vectors of the
operands, or two numbers side by side if operations differ. Signs, which a mirror changes, are kept separate from the
vectors and only cost something if two of them with different signs meet in a sum. Expressions of both sides are
computed once; references across the sides use the other lane. So a pair of independent sides halves the work, and a
rack or a body between them costs little.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

from rig_sim.compile.constants import ConstantTable, load_text
from rig_sim.compile.llvm_text import PAIR, SCALAR, declarations, literal, operation_lines
from rig_sim.compile.operations import COMMUTATIVE, LEAVES, Operation
from rig_sim.compile.symmetry import Mirror, find_mirrors
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

Key = tuple[int, int]
Signs = tuple[float, float]
PLUS: Signs = (1.0, 1.0)
SUMS = frozenset({Operation.ADD, Operation.SUBTRACT})
#: Operations whose result has the product of the operands' signs.
PRODUCTS = frozenset({Operation.MULTIPLY, Operation.DIVIDE})

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
    """Return the expression without negations, and its sign."""
    sign = 1.0
    while expression.operation is Operation.NEGATE:
        expression, sign = expression.operands[0], -sign
    return expression, sign


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


_VECTOR = PAIR.numbers


@dataclass(frozen=True)
class LaneFunction:
    """A planned function of arrays, ``void name(const double *argument…, double *result…)``.

    `places` has argument and position of every leaf, by its index. A pair is stored at its position and the next one.
    """

    name: str
    plan: LanePlan
    places: dict[int, tuple[int, int]]
    pairs: tuple[tuple[tuple[int, Expression, Expression], ...], ...]
    singles: tuple[tuple[tuple[int, Expression], ...], ...]


def lane_function_text(function: LaneFunction, *, contract: bool, table: ConstantTable) -> str:
    """Write one function."""
    writer = _Writer(function, " contract" if contract else "", table)
    for item in function.plan.order():
        if isinstance(item, tuple):
            writer.vector(item)
        else:
            writer.scalar(item)
    for array, (pairs, singles) in enumerate(zip(function.pairs, function.singles, strict=True)):
        for position, a, b in pairs:
            writer.store(array, position, writer.signed_pair(a, b), _VECTOR)
        for position, expression in singles:
            writer.store(array, position, writer.number(expression), SCALAR)
    parameters = [f"ptr noalias readonly %argument{array}" for array in range(2)]
    parameters += [f"ptr noalias %result{array}" for array in range(len(function.pairs))]
    head = f"define void @{function.name}({', '.join(parameters)}) noinline nounwind {{"
    return "\n".join([head, *writer.lines, "ret void", "}"])


class _Writer:
    """Writer of the lines of one function."""

    def __init__(self, function: LaneFunction, flags: str, table: ConstantTable) -> None:
        self._table = table
        self._plan = function.plan
        self._places = function.places
        self._flags = flags
        self._made: dict[object, str] = {}
        self.lines: list[str] = []

    def store(self, array: int, position: int, value: str, kind: str) -> None:
        self.lines.append(f"%r{array}.{position} = getelementptr {SCALAR}, ptr %result{array}, i64 {position}")
        self.lines.append(f"store {kind} {value}, ptr %r{array}.{position}, align 8")

    def number(self, expression: Expression) -> str:
        """Return a single number: a constant, an input, a computed number, or a lane of a vector."""
        if expression.value is not None:
            return self._constants([expression.value])
        index = expression.index
        if expression.operation is Operation.INPUT:
            return self._once(index, lambda name: self._load(expression, name, SCALAR))
        if index not in self._plan.lane_of:
            return self._made[index]
        key, lane = self._plan.lane_of[index]
        taken = self._once(
            ("lane", index), lambda name: [f"{name} = extractelement {_VECTOR} {self._made[key]}, i32 {lane}"]
        )
        if self._plan.signs[key][lane] > 0.0:
            return taken
        return self._once(("minus", index), lambda name: [f"{name} = fneg {SCALAR} {taken}"])

    def scalar(self, index: int) -> None:
        expression = self._plan.scalars[index]
        operands = [self.number(operand) for operand in expression.operands]
        self._once(index, lambda name: operation_lines(expression.operation, operands, self._flags, name=name))

    def vector(self, key: Key) -> None:
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return
        if vector.form is Form.LOAD:
            self._once(key, lambda name: self._load(vector.expressions[0], name, _VECTOR))
        elif vector.form is Form.SWAP:
            other = self._made[vector.operands[0]]
            swapped = f"shufflevector {_VECTOR} {other}, {_VECTOR} poison, <2 x i32> <i32 1, i32 0>"
            self._once(key, lambda name: [f"{name} = {swapped}"])
        elif vector.form is Form.OPERATION:
            self._operation(key, vector)
        else:
            first, second = (self.number(expression) for expression in vector.expressions)
            self._once(
                key,
                lambda name: [
                    f"{name}.0 = insertelement {_VECTOR} poison, {SCALAR} {first}, i32 0",
                    f"{name} = insertelement {_VECTOR} {name}.0, {SCALAR} {second}, i32 1",
                ],
            )

    def signed_pair(self, a: Expression, b: Expression) -> str:
        """Return two expressions with their signs."""
        (first, sign), (second, other) = stripped(a), stripped(b)
        return self._signed((first.index, second.index), (sign, other))

    def _operation(self, key: Key, vector: Vector) -> None:
        operation = vector.expressions[0].operation
        if operation in SUMS:
            self._sum(key, vector)
            return
        bare = operation in PRODUCTS or operation is Operation.ABS
        operands = [
            self._bare(operand) if bare else self._signed(operand, factor)
            for operand, factor in zip(vector.operands, vector.factors, strict=True)
        ]
        self._once(key, lambda name: operation_lines(operation, operands, self._flags, name=name, kind=PAIR))

    def _sum(self, key: Key, vector: Vector) -> None:
        (a, b), (first, second) = vector.operands, vector.factors
        relative = times(times(self._plan.signs[a], first), times(self._plan.signs[b], second))
        x = self._bare(a)
        if relative in {PLUS, (-1.0, -1.0)}:
            word, y = ("fadd" if relative == PLUS else "fsub"), self._bare(b)
        else:
            word, y = "fadd", self._turned(b, relative)
        self._once(key, lambda name: [f"{name} = {word}{self._flags} {_VECTOR} {x}, {y}"])

    def _bare(self, key: Key) -> str:
        """Return a vector without the signs that its users must apply."""
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return self._constants([float(expression) for expression in vector.expressions])
        return self._made[key]

    def _signed(self, key: Key, factor: Signs) -> str:
        return self._turned(key, times(self._plan.signs[key], factor))

    def _turned(self, key: Key, signs: Signs) -> str:
        """Return a vector with its lanes multiplied by signs."""
        if signs == PLUS:
            return self._bare(key)
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return self._constants(
                [sign * float(number) for sign, number in zip(signs, vector.expressions, strict=True)]
            )
        bare = self._bare(key)
        if signs == (-1.0, -1.0):
            return self._once(("turned", key, signs), lambda name: [f"{name} = fneg {_VECTOR} {bare}"])
        # The product is exact, and becomes one operation with its sum.
        factors = self._constants(signs)
        return self._once(
            ("turned", key, signs), lambda name: [f"{name} = fmul{self._flags} {_VECTOR} {bare}, {factors}"]
        )

    def _constants(self, values: Sequence[float]) -> str:
        """Return one constant, or two as a vector: read from the table, or written into the code."""
        place = self._table.place(values)
        if place is not None:
            kind = SCALAR if len(values) == 1 else _VECTOR
            return self._once(("constants", place), lambda name: [load_text(name, kind, place)])
        if len(values) == 1:
            return literal(values[0])
        return f"<{', '.join(f'{SCALAR} {literal(value)}' for value in values)}>"

    def _load(self, leaf: Expression, name: str, kind: str) -> list[str]:
        array, position = self._places[leaf.index]
        return [
            f"{name}.p = getelementptr {SCALAR}, ptr %argument{array}, i64 {position}",
            f"{name} = load {kind}, ptr {name}.p, align 8",
        ]

    def _once(self, what: object, lines: Callable[[str], list[str]]) -> str:
        if what not in self._made:
            name = f"%x{len(self._made)}"
            self.lines.extend(lines(name))
            self._made[what] = name
        return self._made[what]


Pair = tuple[int, int]


def lane_texts(traced: TracedModel, *, contract: bool, table: ConstantTable) -> tuple[str, tuple[int, ...]] | None:
    """Return the model in two lanes, and the state at each place of the arrays: pairs first, side by side.

    None if no mirror is found that saves operations.
    """
    for mirror in find_mirrors(traced):
        pairs = _state_pairs(traced, mirror)
        order = tuple(place for pair in pairs for place in pair)
        order += tuple(place for place in range(len(traced.state)) if place not in set(order))
        derivative = _function("derivative", traced, mirror, pairs=pairs, order=order)
        if not is_worthwhile(derivative.plan, traced.derivative):
            continue
        observe = _function("observe", traced, mirror, pairs=pairs, order=order)
        try:
            functions = [
                lane_function_text(function, contract=contract, table=table) for function in (derivative, observe)
            ]
        except ValueError:
            continue  # vectors that need each other: no usable mirror
        return "\n".join([declarations(PAIR), *functions]), order
    return None


def _state_pairs(traced: TracedModel, mirror: Mirror) -> list[Pair]:
    places = {state.index: place for place, state in enumerate(traced.state)}
    return sorted((places[a.index], places[b.index]) for a, b in mirror.pairs if a.index in places)


def _function(
    name: str, traced: TracedModel, mirror: Mirror, *, pairs: list[Pair], order: tuple[int, ...]
) -> LaneFunction:
    rates = traced.derivative
    paired = [(2 * place, rates[a], rates[b]) for place, (a, b) in enumerate(pairs)]
    single = [(place, rates[order[place]]) for place in range(2 * len(pairs), len(order))]
    outputs = list(enumerate(traced.outputs)) if name == "observe" else []
    output_pairs = _output_pairs([output for _, output in outputs], mirror)
    plan = plan_lanes(
        mirror,
        pairs=[*((a, b) for _, a, b in paired), *output_pairs],
        singles=[*(rate for _, rate in single), *(output for _, output in outputs)],
        side_by_side=[(traced.state[a].index, traced.state[b].index) for a, b in pairs],
    )
    places = {traced.state[at].index: (0, place) for place, at in enumerate(order)}
    places |= {leaf.index: (1, place) for place, leaf in enumerate(traced.inputs)}
    with_outputs = name == "observe"
    return LaneFunction(
        name=name,
        plan=plan,
        places=places,
        pairs=(tuple(paired), ()) if with_outputs else (tuple(paired),),
        singles=(tuple(single), tuple(outputs)) if with_outputs else (tuple(single),),
    )


def _output_pairs(outputs: list[Expression], mirror: Mirror) -> list[tuple[Expression, Expression]]:
    """Pair outputs of both sides, the first in lane 0; they are stored one by one, but computed together."""
    partners: dict[int, Expression] = {}
    for output in outputs:
        partners.setdefault(mirror.second[output.index], output)
    found = []
    for output in outputs:
        partner = partners.get(mirror.first[output.index])
        if partner is not None and partner is not output:
            found.append((output, partner))
    return found
