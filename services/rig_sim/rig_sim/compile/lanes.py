"""Lanes of a mirrored model: expressions in pairs as one vector, and others, as :mod:`rig_sim.compile.lane_plan` says.

A lane is a number of one rig, or of each of several rigs of one structure side by side. Expressions of both sides are
computed once; references across the sides use the other lane. So a pair of independent sides halves the work, and a
rack or a body between them costs little.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rig_sim.compile.constants import Entry, Table
from rig_sim.compile.lane_plan import (
    MINUS,
    PLUS,
    PRODUCTS,
    SUMS,
    Form,
    Key,
    LanePlan,
    Signs,
    Vector,
    is_worthwhile,
    key_of,
    plan_lanes,
    rank_of,
    stripped,
    times,
)
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
from rig_sim.compile.operations import Operation
from rig_sim.compile.symmetry import Mirror, find_mirrors
from rig_sim.compile.tracing import Expression, TracedModel


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
        pending: list[Key | int] = [key_of(a, b) for _, a, b in self.pairs[0]]
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
            uses.update(key_of(a, b) for _, a, b in pairs)
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
        terms = sorted(self._chains.terms(self._plan, key), key=lambda term: rank_of(term[0]))
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
        if signs in {PLUS, MINUS}:
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
        if signs == MINUS:
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

    `sums`: Sums that only one sum uses, and which become part of it. `products`: Products that only one sum uses, and
    which are fused with it.
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
