"""Write a plan of lanes as LLVM IR: vectors of two doubles, and doubles where both sides share a number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rig_sim.compile.lanes import PLUS, PRODUCTS, SUMS, Form, Key, LanePlan, Signs, Vector, stripped
from rig_sim.compile.llvm_text import PAIR, SCALAR, literal, operation_lines
from rig_sim.compile.operations import Operation
from rig_sim.compile.packing import times
from rig_sim.compile.tracing import Expression

_VECTOR = PAIR.numbers


@dataclass(frozen=True)
class LaneFunction:
    """A planned function of arrays, ``void name(const double *argument…, double *result…)``.

    `name`: Its symbol. `places`: The argument and the position in it of every leaf, by its index. `arguments`: How many
    argument arrays there are. `pairs`, `singles`: A pair is stored at its position and the one after it.
    """

    name: str
    plan: LanePlan
    places: dict[int, tuple[int, int]]
    arguments: int
    pairs: tuple[tuple[tuple[int, Expression, Expression], ...], ...]
    singles: tuple[tuple[tuple[int, Expression], ...], ...]


def lane_function_text(function: LaneFunction, *, contract: bool) -> str:
    """Write one function."""
    writer = _Writer(function, " contract" if contract else "")
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
    parameters = [f"ptr noalias readonly %argument{array}" for array in range(function.arguments)]
    parameters += [f"ptr noalias %result{array}" for array in range(len(function.pairs))]
    head = f"define void @{function.name}({', '.join(parameters)}) noinline nounwind {{"
    return "\n".join([head, *writer.lines, "ret void", "}"])


class _Writer:
    """The lines of one function so far."""

    def __init__(self, function: LaneFunction, flags: str) -> None:
        self._plan = function.plan
        self._places = function.places
        self._flags = flags
        self._made: dict[object, str] = {}
        self.lines: list[str] = []

    def store(self, array: int, position: int, value: str, kind: str) -> None:
        self.lines.append(f"%r{array}.{position} = getelementptr {SCALAR}, ptr %result{array}, i64 {position}")
        self.lines.append(f"store {kind} {value}, ptr %r{array}.{position}, align 8")

    def number(self, expression: Expression) -> str:
        """Return a single number: a constant, an input, computed, or a lane of a vector."""
        if expression.value is not None:
            return literal(expression.value)
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
        """Return a vector without the signs it leaves to its users."""
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return _constants([float(expression) for expression in vector.expressions])
        return self._made[key]

    def _signed(self, key: Key, factor: Signs) -> str:
        return self._turned(key, times(self._plan.signs[key], factor))

    def _turned(self, key: Key, signs: Signs) -> str:
        """Return a vector with its lanes turned by signs."""
        if signs == PLUS:
            return self._bare(key)
        vector = self._plan.vectors[key]
        if vector.form is Form.CONSTANTS:
            return _constants([sign * float(number) for sign, number in zip(signs, vector.expressions, strict=True)])
        bare = self._bare(key)
        if signs == (-1.0, -1.0):
            return self._once(("turned", key, signs), lambda name: [f"{name} = fneg {_VECTOR} {bare}"])
        # The product is exact, and becomes one operation with the sum it goes into.
        return self._once(
            ("turned", key, signs),
            lambda name: [f"{name} = fmul{self._flags} {_VECTOR} {bare}, {_constants(signs)}"],
        )

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


def _constants(values: Sequence[float]) -> str:
    return f"<{', '.join(f'{SCALAR} {literal(value)}' for value in values)}>"
