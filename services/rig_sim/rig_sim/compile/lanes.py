"""Lanes of a mirrored model: expressions computed in pairs as one vector, and others.

A lane is a number of one rig, or of each of several rigs of one structure side by side. A vector holds one expression
of either side and is correct for any pair: the same operation on vectors of the operands, or two numbers side by side
if operations differ. Signs, which a mirror changes, are kept separate from the
vectors and only cost something if two of them with different signs meet in a sum. Expressions of both sides are
computed once; references across the sides use the other lane. So a pair of independent sides halves the work, and a
rack or a body between them costs little.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

from rig_sim.compile.constants import Entry, Table
from rig_sim.compile.llvm_text import (
    INFIX,
    Kind,
    fused_lines,
    half_line,
    joined_lines,
    operation_lines,
    swapped_line,
    vector_kind,
)
from rig_sim.compile.operations import COMMUTATIVE, LEAVES, Operation
from rig_sim.compile.symmetry import Mirror, find_mirrors
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

Key = tuple[int, int]
Signs = tuple[float, float]
PLUS: Signs = (1.0, 1.0)
_MINUS: Signs = (-1.0, -1.0)
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

    def is_possible(self) -> bool:
        """Return whether no two vectors need each other: else the mirror is not usable."""
        try:
            return all(True for _ in self.order())
        except ValueError:
            return False

    def _vector_needs(self, vector: Vector) -> list[Key | int]:
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

    def uses(self) -> Counter[Key | int]:
        """Count the users of each vector and each single number."""
        plan = self.plan
        uses: Counter[Key | int] = Counter()
        for vector in plan.vectors.values():
            uses.update(vector.operands)
            if vector.form is Form.SPLAT or vector.form is Form.GATHER:
                uses.update(plan.made_as(expression) for expression in vector.expressions)
        for scalar in plan.scalars.values():
            uses.update(plan.made_as(operand) for operand in scalar.operands)
        for pairs, singles in zip(self.pairs, self.singles, strict=True):
            uses.update((stripped(a)[0].index, stripped(b)[0].index) for _, a, b in pairs)
            uses.update(plan.made_as(expression) for _, expression in singles)
        return uses


def lane_function_text(function: LaneFunction, *, contract: bool, table: Table, rigs: int) -> str:
    """Write one function.

    For several rigs the products that are used only in one sum are fused with it here, and not by the compiler: the
    roundings must not depend on a vector's width.
    """
    writer = _Writer(function, table, contract=contract, rigs=rigs)
    for item in function.plan.order():
        if isinstance(item, tuple):
            writer.vector(item)
        else:
            writer.scalar(item)
    for array, (pairs, singles) in enumerate(zip(function.pairs, function.singles, strict=True)):
        for position, a, b in pairs:
            writer.store(array, position, writer.signed_pair(a, b), writer.two)
        for position, expression in singles:
            writer.store(array, position, writer.number(expression), writer.one)
    parameters = [f"ptr noalias readonly %argument{array}" for array in range(2)]
    parameters.append(table.parameter)
    parameters += [f"ptr noalias %result{array}" for array in range(len(function.pairs))]
    head = f"define void @{function.name}({', '.join(parameters)}) noinline nounwind{writer.two.attributes} {{"
    return "\n".join([head, *writer.lines, "ret void", "}"])


class _Writer:
    """Writer of the lines of one function; `one` is the kind of a lane, `two` that of a vector of both sides."""

    def __init__(self, function: LaneFunction, table: Table, *, contract: bool, rigs: int) -> None:
        self.one = vector_kind(rigs)
        self.two = vector_kind(2 * rigs)
        self.lines: list[str] = []
        self._table = table
        self._plan = function.plan
        self._places = function.places
        self._flags = " contract" if contract and rigs == 1 else ""
        self._made: dict[object, str] = {}
        #: Operand of a sum that is a product and fused with it.
        self._fused: dict[Key | int, int] = _fused_products(function) if contract and rigs > 1 else {}
        self._within_sums = {self._operands(item)[place] for item, place in self._fused.items()}

    def _operands(self, item: Key | int) -> Sequence[Key | int]:
        if isinstance(item, tuple):
            return self._plan.vectors[item].operands
        return [operand.index for operand in self._plan.scalars[item].operands]

    def store(self, array: int, position: int, value: str, kind: Kind) -> None:
        pointer = f"%r{array}.{position}"
        self.lines.append(f"{pointer} = getelementptr {self.one.numbers}, ptr %result{array}, i64 {position}")
        self.lines.append(f"store {kind.numbers} {value}, ptr {pointer}, align 8")

    def number(self, expression: Expression) -> str:
        """Return a single number: a constant, an input, a computed number, or a lane of a vector."""
        if self._table.holds(expression):
            return self._constants([self._table.entry(expression)])
        index = expression.index
        if expression.operation is Operation.INPUT:
            return self._once(index, lambda name: self._load(expression, name, self.one))
        if index not in self._plan.lane_of:
            return self._made[index]
        key, lane = self._plan.lane_of[index]
        taken = self._once(("lane", index), lambda name: [half_line(name, self._made[key], lane, self.two)])
        return taken if self._plan.signs[key][lane] > 0.0 else self._negative(taken, self.one)

    def scalar(self, index: int) -> None:
        if index in self._within_sums:
            return
        expression = self._plan.scalars[index]
        if index in self._fused:
            self._fused_scalar(expression, self._fused[index])
            return
        operands = [self.number(operand) for operand in expression.operands]
        self._once(
            index,
            lambda name: operation_lines(expression.operation, operands, self._flags, name=name, kind=self.one),
        )

    def _fused_scalar(self, expression: Expression, place: int) -> None:
        product, other = expression.operands[place], expression.operands[1 - place]
        first, second, addend = (self.number(operand) for operand in (*product.operands, other))
        if expression.operation is Operation.SUBTRACT:
            if place == 0:
                addend = self._negative(addend, self.one)
            else:
                first = self._negative(first, self.one)
        self._once(expression.index, lambda name: fused_lines([first, second], addend, name=name, kind=self.one))

    def vector(self, key: Key) -> None:
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS or key in self._within_sums:
            return
        if vector.form is Form.LOAD:
            self._once(key, lambda name: self._load(vector.expressions[0], name, self.two))
        elif vector.form is Form.SWAP:
            self._once(key, lambda name: [swapped_line(name, self._made[vector.operands[0]], self.two)])
        elif vector.form is Form.OPERATION:
            self._operation(key, vector)
        else:
            first, second = (self.number(expression) for expression in vector.expressions)
            self._once(key, lambda name: joined_lines(name, (first, second), self.two))

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
        self._once(key, lambda name: operation_lines(operation, operands, self._flags, name=name, kind=self.two))

    def _sum(self, key: Key, vector: Vector) -> None:
        (a, b), (first, second) = vector.operands, vector.factors
        relative = times(times(self._plan.signs[a], first), times(self._plan.signs[b], second))
        if key in self._fused:
            self._fused_sum(key, (a, b), relative)
            return
        x, y = self._bare(a), self._bare(b)
        if relative in {PLUS, _MINUS}:
            word = INFIX[Operation.ADD if relative == PLUS else Operation.SUBTRACT]
            self._once(key, lambda name: [f"{name} = {word}{self._flags} {self.two.numbers} {x}, {y}"])
        else:
            # The product is exact, so it does not matter whether it is fused.
            factors = [y, self._constants(relative)]
            self._once(key, lambda name: fused_lines(factors, x, name=name, kind=self.two))

    def _fused_sum(self, key: Key, operands: tuple[Key, Key], relative: Signs) -> None:
        """Write ``a + relative * b``, of which one is a product."""
        place = self._fused[key]
        factors = self._plan.vectors[operands[place]].operands
        # Signs of a constant cost nothing.
        factors = sorted(factors, key=lambda factor: self._plan.vectors[factor].form is not Form.CONSTANTS)
        signs = (relative, PLUS) if place == 0 else (PLUS, relative)
        addend = self._turned(operands[1 - place], signs[0])
        texts = [self._turned(factors[0], signs[1]), self._bare(factors[1])]
        self._once(key, lambda name: fused_lines(texts, addend, name=name, kind=self.two))

    def _bare(self, key: Key) -> str:
        """Return a vector without the signs that its users must apply."""
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return self._constants([self._table.entry(expression) for expression in vector.expressions])
        return self._made[key]

    def _signed(self, key: Key, factor: Signs) -> str:
        return self._turned(key, times(self._plan.signs[key], factor))

    def _turned(self, key: Key, signs: Signs) -> str:
        """Return a vector with its lanes multiplied by signs."""
        if signs == PLUS:
            return self._bare(key)
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return self._constants([self._table.entry(*term) for term in zip(vector.expressions, signs, strict=True)])
        bare = self._bare(key)
        if signs == _MINUS:
            return self._negative(bare, self.two)
        factors = self._constants(signs)
        return self._once(
            ("turned", key, signs), lambda name: [f"{name} = fmul{self._flags} {self.two.numbers} {bare}, {factors}"]
        )

    def _negative(self, value: str, kind: Kind) -> str:
        return self._once(("minus", value), lambda name: [f"{name} = fneg {kind.numbers} {value}"])

    def _constants(self, entries: Sequence[Entry]) -> str:
        """Return one constant, or two as a vector."""
        if self.one.lanes > 1 and len(entries) == 2 and entries[0] == entries[1]:
            # Half the memory for it, and 1 % less time for an evaluation.
            half = self._constants(entries[:1])
            return self._once(("both", half), lambda name: joined_lines(name, (half, half), self.two))
        place = self._table.place(entries)
        kind = self.one if len(entries) == 1 else self.two
        return self._once(
            ("constants", place, len(entries)), lambda name: self._table.load_lines(name, kind.numbers, place)
        )

    def _load(self, leaf: Expression, name: str, kind: Kind) -> list[str]:
        array, position = self._places[leaf.index]
        return [
            f"{name}.p = getelementptr {self.one.numbers}, ptr %argument{array}, i64 {position}",
            f"{name} = load {kind.numbers}, ptr {name}.p, align 8",
        ]

    def _once(self, what: object, lines: Callable[[str], list[str]]) -> str:
        if what not in self._made:
            name = f"%x{len(self._made)}"
            self.lines.extend(lines(name))
            self._made[what] = name
        return self._made[what]


def _fused_products(function: LaneFunction) -> dict[Key | int, int]:
    """Return the sums with a product that nothing else uses, and the product's place among the operands."""
    plan, uses = function.plan, function.uses()
    made: dict[Key | int, tuple[Operation, Sequence[Key | int]]] = {
        key: (vector.expressions[0].operation, vector.operands)
        for key, vector in plan.vectors.items()
        if vector.form is Form.OPERATION
    }
    made |= {
        index: (scalar.operation, [operand.index for operand in scalar.operands])
        for index, scalar in plan.scalars.items()
    }
    found: dict[Key | int, int] = {}
    for item, (operation, operands) in made.items():
        if operation in SUMS:
            # Of two products the one made last, because the other is available earlier.
            for place in sorted((0, 1), key=lambda place: _rank(operands[place]), reverse=True):
                product = operands[place]
                if product in made and made[product][0] is Operation.MULTIPLY and uses[product] == 1:
                    found[item] = place
                    break
    return found


Pair = tuple[int, int]


@dataclass(frozen=True)
class MirroredModel:
    """A model planned in two lanes; `order` is the state at each place of the arrays: pairs first, side by side."""

    functions: tuple[LaneFunction, LaneFunction]
    order: tuple[int, ...]

    def text(self, *, contract: bool, table: Table, rigs: int = 1) -> str:
        """Write the functions `derivative` and `observe`, for a number of rigs at a time."""
        return "\n".join(
            lane_function_text(function, contract=contract, table=table, rigs=rigs) for function in self.functions
        )


def mirrored_model(traced: TracedModel, constants: Sequence[Expression] = ()) -> MirroredModel | None:
    """Return the model in two lanes; None if no mirror is found that saves operations.

    `constants` are the leaves of united variants that are constants.
    """
    for mirror in find_mirrors(traced, constants):
        pairs = _state_pairs(traced, mirror)
        order = tuple(place for pair in pairs for place in pair)
        order += tuple(place for place in range(len(traced.state)) if place not in set(order))
        derivative = _function("derivative", traced, mirror, pairs=pairs, order=order)
        if not is_worthwhile(derivative.plan, traced.derivative):
            continue
        observe = _function("observe", traced, mirror, pairs=pairs, order=order)
        if all(function.plan.is_possible() for function in (derivative, observe)):
            return MirroredModel((derivative, observe), order)
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
