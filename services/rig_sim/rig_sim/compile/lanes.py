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
    function_text,
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
            created, kind, _ = _rank(item)
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


def _rank(item: Key | int) -> tuple[int, int, Key | int]:
    return (item[0], 0, item) if isinstance(item, tuple) else (item, 1, item)


def stripped(expression: Expression) -> tuple[Expression, float]:
    """Return the expression without negations, and its sign."""
    sign = 1.0
    while expression.operation is Operation.NEGATE:
        expression, sign = expression.operands[0], -sign
    return expression, sign


def _key(a: Expression, b: Expression) -> Key:
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


@dataclass(frozen=True)
class LaneFunction:
    """The planned function of a model: derivatives, then outputs.

    `places` has argument and position of every leaf, by its index. `pairs` and `singles` are the results of both. A
    pair is stored at its position and the next one.
    """

    plan: LanePlan
    places: dict[int, tuple[int, int]]
    pairs: tuple[tuple[tuple[int, Expression, Expression], ...], ...]
    singles: tuple[tuple[tuple[int, Expression], ...], ...]

    def parts(self) -> tuple[list[Key | int], list[Key | int]]:
        """Return what the derivatives need and what only the outputs need, operands first."""
        plan = self.plan
        pending: list[Key | int] = [_key(a, b) for _, a, b in self.pairs[0]]
        pending += [plan.made_as(expression) for _, expression in self.singles[0]]
        needed: set[Key | int] = set()
        while pending:
            item = pending.pop()
            if item not in needed and (item in plan.vectors or item in plan.scalars):
                needed.add(item)
                pending.extend(plan.needs(item))
        order = list(plan.order())
        return [item for item in order if item in needed], [item for item in order if item not in needed]

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
            uses.update(_key(a, b) for _, a, b in pairs)
            uses.update(plan.made_as(expression) for _, expression in singles)
        return uses


def lane_function_text(function: LaneFunction, *, contract: bool, table: Table, rigs: int) -> str:
    """Write one function.

    If products and sums may be fused, sums of sums are written as one chain, which starts from what is no product: then
    every product costs nothing but its sum. For several rigs they are fused here, and not by the compiler: the
    roundings must not depend on a vector's width.
    """
    writer = _Writer(function, table, contract=contract, rigs=rigs)
    main, outputs = (writer.part(array, items) for array, items in enumerate(function.parts()))
    return function_text(main, outputs, writer.two, table)


class _Writer:
    """Writer of the lines of one function; `one` is the kind of a lane, `two` that of a vector of both sides."""

    def __init__(self, function: LaneFunction, table: Table, *, contract: bool, rigs: int) -> None:
        self.one = vector_kind(rigs)
        self.two = vector_kind(2 * rigs)
        self.lines: list[str] = []
        self._table = table
        self._function = function
        self._plan = function.plan
        self._places = function.places
        self._flags = " contract" if contract and rigs == 1 else ""
        self._made: dict[object, str] = {}
        self._chains = _Chains.of(function) if contract else _Chains()
        #: Operand of a scalar sum that is a product and fused with it.
        self._fused: dict[int, int] = _fused_products(function) if contract and rigs > 1 else {}
        self._within_sums = {self._plan.scalars[index].operands[place].index for index, place in self._fused.items()}

    def part(self, array: int, items: Sequence[Key | int]) -> list[str]:
        """Return the lines of some vectors and single numbers, and of the stores of an array of results."""
        begin = len(self.lines)
        for item in items:
            if isinstance(item, tuple):
                self.vector(item)
            else:
                self.scalar(item)
        for position, a, b in self._function.pairs[array]:
            self.store(array, position, self.signed_pair(a, b), self.two)
        for position, expression in self._function.singles[array]:
            self.store(array, position, self.number(expression), self.one)
        return self.lines[begin:]

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
        constants = [self._table.holds(operand) for operand in expression.operands]
        self._once(
            index,
            lambda name: operation_lines(
                expression.operation, operands, self._flags, name=name, kind=self.one, constants=constants
            ),
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
        if vector.form is Form.CONSTANTS or key in self._chains.within:
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
            self._sum(key)
            return
        bare = operation in PRODUCTS or operation is Operation.ABS
        operands = [
            self._bare(operand) if bare else self._signed(operand, factor)
            for operand, factor in zip(vector.operands, vector.factors, strict=True)
        ]
        constants = [self._plan.vectors[operand].form is Form.CONSTANTS for operand in vector.operands]
        self._once(
            key,
            lambda name: operation_lines(
                operation, operands, self._flags, name=name, kind=self.two, constants=constants
            ),
        )

    def _sum(self, key: Key) -> None:
        """Write a sum term by term, what is available first first."""
        products = self._chains.products
        terms = sorted(self._chains.terms(self._plan, key), key=lambda term: _rank(term[0]))
        # One term at least has the sign of the sum.
        first = min(terms, key=lambda term: (term[1] != PLUS, term[0] in products))
        terms.remove(first)
        if first[0] not in products:
            total = self._bare(first[0])
        elif (other := next((term for term in terms if term[0] not in products), None)) is not None:
            terms.remove(other)
            total = self._added_product(first, self._turned(*other))
        else:
            total = self._product(first[0])
        for term in terms:
            total = self._added_product(term, total) if term[0] in products else self._added(term, total)
        self._made[key] = total

    def _added(self, term: _Term, total: str) -> str:
        """Write a sum and a term."""
        key, signs = term
        value = self._bare(key)
        if signs in {PLUS, _MINUS}:
            word = INFIX[Operation.ADD if signs == PLUS else Operation.SUBTRACT]
            return self._new(lambda name: [f"{name} = {word}{self._flags} {self.two.numbers} {total}, {value}"])
        # The product is exact, so it does not matter whether it is fused.
        factors = [value, self._constants(signs)]
        return self._new(lambda name: fused_lines(factors, total, name=name, kind=self.two))

    def _added_product(self, term: _Term, total: str) -> str:
        """Write a sum and a term that is a product."""
        key, signs = term
        first, second = self._factors(key)
        factors = [self._turned(first, signs), self._bare(second)]
        if self.one.lanes > 1:
            return self._new(lambda name: fused_lines(factors, total, name=name, kind=self.two))
        product = self._new(lambda name: self._product_lines(name, factors))
        return self._new(lambda name: [f"{name} = fadd{self._flags} {self.two.numbers} {total}, {product}"])

    def _product(self, key: Key) -> str:
        factors = [self._bare(factor) for factor in self._factors(key)]
        return self._new(lambda name: self._product_lines(name, factors))

    def _product_lines(self, name: str, factors: Sequence[str]) -> list[str]:
        return operation_lines(Operation.MULTIPLY, factors, self._flags, name=name, kind=self.two)

    def _factors(self, product: Key) -> Sequence[Key]:
        """Return the factors of a product, a constant first: its signs cost nothing."""
        vectors = self._plan.vectors
        return sorted(vectors[product].operands, key=lambda factor: vectors[factor].form is not Form.CONSTANTS)

    def _new(self, lines: Callable[[str], list[str]]) -> str:
        return self._once(("part", len(self._made)), lines)

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


_Term = tuple[Key, Signs]


@dataclass(frozen=True)
class _Chains:
    """Sums that are written as chains of terms.

    `sums`: Sums that only one sum uses, and which become part of it. `products`: Products that only sums use; each sum
    computes them itself.
    """

    sums: frozenset[Key] = frozenset()
    products: frozenset[Key] = frozenset()

    @classmethod
    def of(cls, function: LaneFunction) -> _Chains:
        """Find the sums and products that need not be written by themselves."""
        uses = function.uses()
        operations = {key: vector for key, vector in function.plan.vectors.items() if vector.form is Form.OPERATION}
        sums = {key for key, vector in operations.items() if vector.expressions[0].operation in SUMS}
        within = Counter(operand for key in sums for operand in operations[key].operands)
        return cls(
            sums=frozenset(key for key in sums if uses[key] == within[key] == 1),
            products=frozenset(
                key
                for key, vector in operations.items()
                if vector.expressions[0].operation is Operation.MULTIPLY and uses[key] == within[key] == 1
            ),
        )

    @property
    def within(self) -> frozenset[Key]:
        """Vectors that are not written by themselves."""
        return self.sums | self.products

    def terms(self, plan: LanePlan, key: Key, signs: Signs = PLUS) -> Iterator[_Term]:
        """Return the terms of a sum, with the signs by which a sum of the vectors as written has them."""
        vector = plan.vectors[key]
        first, second = (
            times(plan.signs[operand], factor) for operand, factor in zip(vector.operands, vector.factors, strict=True)
        )
        for operand, relative in zip(vector.operands, (PLUS, times(first, second)), strict=True):
            if operand in self.sums:
                yield from self.terms(plan, operand, times(signs, relative))
            else:
                yield operand, times(signs, relative)


def _fused_products(function: LaneFunction) -> dict[int, int]:
    """Return the single sums with a product that nothing else uses, and the product's place among the operands."""
    scalars, uses = function.plan.scalars, function.uses()
    found: dict[int, int] = {}
    for index, scalar in scalars.items():
        if scalar.operation in SUMS:
            # Of two products the one made last, because the other is available earlier.
            for place in sorted((0, 1), key=lambda place: scalar.operands[place].index, reverse=True):
                product = scalar.operands[place].index
                if product in scalars and scalars[product].operation is Operation.MULTIPLY and uses[product] == 1:
                    found[index] = place
                    break
    return found


Pair = tuple[int, int]


@dataclass(frozen=True)
class MirroredModel:
    """A model planned in two lanes; `order` is the state at each place of the arrays: pairs first, side by side."""

    function: LaneFunction
    order: tuple[int, ...]

    def text(self, *, contract: bool, table: Table, rigs: int = 1) -> str:
        """Write the function of the model, for a number of rigs at a time."""
        return lane_function_text(self.function, contract=contract, table=table, rigs=rigs)


def mirrored_model(traced: TracedModel, constants: Sequence[Expression] = ()) -> MirroredModel | None:
    """Return the model in two lanes; None if no mirror is found that saves operations.

    `constants` are the leaves of united variants that are constants.
    """
    for mirror in find_mirrors(traced, constants):
        pairs = _state_pairs(traced, mirror)
        order = tuple(place for pair in pairs for place in pair)
        order += tuple(place for place in range(len(traced.state)) if place not in set(order))
        function = _function(traced, mirror, pairs=pairs, order=order)
        if is_worthwhile(function.plan, (*traced.derivative, *traced.outputs)) and function.plan.is_possible():
            return MirroredModel(function, order)
    return None


def _state_pairs(traced: TracedModel, mirror: Mirror) -> list[Pair]:
    places = {state.index: place for place, state in enumerate(traced.state)}
    return sorted((places[a.index], places[b.index]) for a, b in mirror.pairs if a.index in places)


def _function(traced: TracedModel, mirror: Mirror, *, pairs: list[Pair], order: tuple[int, ...]) -> LaneFunction:
    rates = traced.derivative
    paired = [(2 * place, rates[a], rates[b]) for place, (a, b) in enumerate(pairs)]
    single = [(place, rates[order[place]]) for place in range(2 * len(pairs), len(order))]
    plan = plan_lanes(
        mirror,
        pairs=[*((a, b) for _, a, b in paired), *_output_pairs(traced.outputs, mirror)],
        singles=[*(rate for _, rate in single), *traced.outputs],
        side_by_side=[(traced.state[a].index, traced.state[b].index) for a, b in pairs],
    )
    places = {traced.state[at].index: (0, place) for place, at in enumerate(order)}
    places |= {leaf.index: (1, place) for place, leaf in enumerate(traced.inputs)}
    return LaneFunction(
        plan=plan,
        places=places,
        pairs=(tuple(paired), ()),
        singles=(tuple(single), tuple(enumerate(traced.outputs))),
    )


def _output_pairs(outputs: Sequence[Expression], mirror: Mirror) -> list[tuple[Expression, Expression]]:
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
