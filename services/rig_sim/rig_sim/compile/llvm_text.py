"""Write traced functions as LLVM IR: loads, straight-line operations, stores.

Models with a mirror are written two lanes at a time by :mod:`rig_sim.compile.lanes`; this module writes all others.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from rig_sim.compile.constants import Table
from rig_sim.compile.operations import INVERSE_SQRT_BITS, LEAVES, Operation
from rig_sim.compile.short_addresses import FREES_REGISTERS, IS_POSSIBLE
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

SCALAR = "double"

INFIX = {
    Operation.ADD: "fadd",
    Operation.SUBTRACT: "fsub",
    Operation.MULTIPLY: "fmul",
    Operation.DIVIDE: "fdiv",
}
INTRINSICS = {
    Operation.ABS: "fabs",
    Operation.SQRT: "sqrt",
    Operation.FLOOR: "floor",
    Operation.FUSED: "fma",
    Operation.MINIMUM: "minimum",
    Operation.MAXIMUM: "maximum",
}
_OPERANDS = {Operation.FUSED: 3, Operation.MINIMUM: 2, Operation.MAXIMUM: 2}
#: Comparisons by which the first operand is the extreme.
_EXTREMES = {Operation.MINIMUM: "olt", Operation.MAXIMUM: "ogt"}
#: 2^n is the double whose exponent's bits, above its 52 others, are n + 1023: which added to 2^52 are a double's last.
_TO_LAST_BITS = 2.0**52 + 1023.0


def literal(value: float) -> str:
    """Write a number so that LLVM reads it back bit by bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


@dataclass(frozen=True)
class Kind:
    """Operand type of an operation, doubles or their vectors, in LLVM's types; the suffix is that of the intrinsics."""

    numbers: str
    bits: str
    truth: str
    suffix: str
    lanes: int

    @property
    def attributes(self) -> str:
        """Attributes of a function of this kind.

        The stack is aligned to more than 16 bytes where vectors are longer: else each spilled one crosses a cache line.
        Registers of 512 bits are not used by default on every processor.
        """
        bits = 64 * self.lanes
        aligned = ' "stackrealign"' if bits > 128 else ""
        return f'{aligned} "min-legal-vector-width"="{bits}" "prefer-vector-width"="{bits}"' if bits > 256 else aligned

    def constant(self, value: str, *, element: str = SCALAR) -> str:
        """Write one literal in every lane."""
        return value if self.lanes == 1 else f"<{', '.join([f'{element} {value}'] * self.lanes)}>"


def vector_kind(lanes: int) -> Kind:
    """Return the kind of a vector of doubles; a vector of one is a double."""
    if lanes == 1:
        return DOUBLE
    return Kind(f"<{lanes} x {SCALAR}>", f"<{lanes} x i64>", f"<{lanes} x i1>", f"v{lanes}f64", lanes)


DOUBLE = Kind(SCALAR, "i64", "i1", "f64", 1)
PAIR = vector_kind(2)


def declarations(*kinds: Kind) -> str:
    """Return the declarations of all intrinsics that are called for these kinds."""
    lines = []
    for kind in dict.fromkeys(kinds):
        for operation, name in INTRINSICS.items():
            arguments = ", ".join([kind.numbers] * _OPERANDS.get(operation, 1))
            lines.append(f"declare {kind.numbers} @llvm.{name}.{kind.suffix}({arguments})")
        if kind.lanes > 1:
            lines.append(f"declare i1 @llvm.vector.reduce.and.v{kind.lanes}i1({kind.truth})")
    return "\n".join(lines)


def fused_lines(factors: Sequence[str], addend: str, *, name: str, kind: Kind) -> list[str]:
    """Write the sum of a product and an addend, rounded once."""
    return operation_lines(Operation.FUSED, [*factors, addend], "", name=name, kind=kind)


def swapped_line(name: str, pair: str, kind: Kind) -> str:
    """Write the exchange of the two halves of a vector."""
    half = kind.lanes // 2
    return _shuffled(name, (pair, "poison"), kind, [*range(half, kind.lanes), *range(half)])


def half_line(name: str, pair: str, side: int, kind: Kind) -> str:
    """Write the first or the second half of a vector."""
    half = kind.lanes // 2
    if half == 1:
        return f"{name} = extractelement {kind.numbers} {pair}, i32 {side}"
    return _shuffled(name, (pair, "poison"), kind, range(side * half, (side + 1) * half))


def joined_lines(name: str, halves: tuple[str, str], kind: Kind) -> list[str]:
    """Write two halves as one vector of a kind."""
    if kind.lanes == 2:
        return [
            f"{name}.0 = insertelement {kind.numbers} poison, {SCALAR} {halves[0]}, i32 0",
            f"{name} = insertelement {kind.numbers} {name}.0, {SCALAR} {halves[1]}, i32 1",
        ]
    return [_shuffled(name, halves, vector_kind(kind.lanes // 2), range(kind.lanes))]


def _shuffled(name: str, vectors: tuple[str, str], kind: Kind, places: Sequence[int]) -> str:
    operands = ", ".join(f"{kind.numbers} {vector}" for vector in vectors)
    mask = ", ".join(f"i32 {place}" for place in places)
    return f"{name} = shufflevector {operands}, <{len(places)} x i32> <{mask}>"


def function_text(main: Sequence[str], outputs: Sequence[str], kind: Kind, table: Table) -> str:
    """Write the function of a model: derivatives always, outputs unless they go to null.

    ``void derivative(const double *state, const double *inputs, const double *constants, double *rates,
    double *outputs)``. One function for both: the code of two would not be in the processor's nearest memory at once.
    """
    parameters = ", ".join(
        [
            *(f"ptr noalias readonly %argument{array}" for array in range(2)),
            table.parameter,
            *(f"ptr noalias %result{array}" for array in range(2)),
        ]
    )
    return "\n".join(
        [
            # noinline: the loop that calls it at every stage must not hold as many copies of it
            f"define void @derivative({parameters}) noinline nounwind{kind.attributes} {{",
            *([FREES_REGISTERS] if IS_POSSIBLE else []),
            *main,
            "%wanted = icmp ne ptr %result1, null",
            "br i1 %wanted, label %outputs, label %end",
            "outputs:",
            *outputs,
            "br label %end",
            "end:",
            "ret void",
            "}",
        ]
    )


def model_text(traced: TracedModel, *, contract: bool, kind: Kind = DOUBLE, table: Table) -> str:
    """Write the function of a model, see `function_text`.

    For another kind than doubles every place of an array holds a vector of it. Constants are read from a table.
    """
    flags, numbers = " contract" if contract else "", kind.numbers
    places = {
        expression.index: (array, position)
        for array, inputs in enumerate((traced.state, traced.inputs))
        for position, expression in enumerate(inputs)
    }
    lines: list[str] = []
    loaded: set[int] = set()
    read: set[int] = set()
    written: set[int] = set()

    def operand(expression: Expression) -> str:
        if table.holds(expression):
            return _constant(expression, kind, table, read=read, lines=lines)
        if expression.operation is Operation.INPUT and expression.index not in loaded:
            if expression.index not in places:
                raise ValueError(f"The input {expression.name!r} is not an input of the model; add it to them.")
            array, position = places[expression.index]
            loaded.add(expression.index)
            lines.append(f"%p{expression.index} = getelementptr {numbers}, ptr %argument{array}, i64 {position}")
            lines.append(f"%v{expression.index} = load {numbers}, ptr %p{expression.index}, align 8")
        return f"%v{expression.index}"

    def write(results: Sequence[Expression], *, array: int) -> list[str]:
        begin = len(lines)
        stores: dict[int, list[int]] = {}
        for position, result in enumerate(results):
            stores.setdefault(result.index, []).append(position)

        def store(expression: Expression) -> None:
            value = operand(expression)
            for position in stores.pop(expression.index, ()):
                lines.append(f"%r{array}.{position} = getelementptr {numbers}, ptr %result{array}, i64 {position}")
                lines.append(f"store {numbers} {value}, ptr %r{array}.{position}, align 8")

        for expression in creation_order(results):
            if expression.operation in LEAVES or expression.index in written:
                continue  # leaves are read where they are used
            written.add(expression.index)
            lines.extend(
                operation_lines(
                    expression.operation,
                    [operand(part) for part in expression.operands],
                    flags,
                    name=f"%v{expression.index}",
                    kind=kind,
                    constants=[table.holds(part) for part in expression.operands],
                )
            )
            if expression.index in stores:
                store(expression)
        for result in results:  # constants, inputs and values written before that are results themselves
            if result.index in stores:
                store(result)
        return lines[begin:]

    return function_text(write(traced.derivative, array=0), write(traced.outputs, array=1), kind, table)


def _constant(expression: Expression, kind: Kind, table: Table, *, read: set[int], lines: list[str]) -> str:
    """Return a constant, read from the table once in a function."""
    place = table.place([table.entry(expression)])
    if place not in read:
        read.add(place)
        lines.extend(table.load_lines(f"%c{place}", kind.numbers, place))
    return f"%c{place}"


def operation_lines(
    operation: Operation,
    operands: Sequence[str],
    flags: str,
    *,
    name: str,
    kind: Kind = DOUBLE,
    constants: Sequence[bool] = (),
) -> list[str]:
    """Write one operation with its value under this name; `constants` tells which operands are constants."""
    numbers = kind.numbers
    if operation in _EXTREMES and any(constants):
        # One instruction in place of six: of a constant and a NaN it returns the second operand, so a NaN stays one.
        bound, value = operands if constants[0] else reversed(operands)
        return [
            f"{name}.c = fcmp {_EXTREMES[operation]} {numbers} {bound}, {value}",
            f"{name} = select {kind.truth} {name}.c, {numbers} {bound}, {numbers} {value}",
        ]
    if operation in INFIX:
        return [f"{name} = {INFIX[operation]}{flags} {numbers} {operands[0]}, {operands[1]}"]
    if operation is Operation.NEGATE:
        return [f"{name} = fneg{flags} {numbers} {operands[0]}"]
    if operation is Operation.SELECT_POSITIVE:
        return [
            f"{name}.c = fcmp oge {numbers} {operands[0]}, {kind.constant(literal(0.0))}",
            f"{name} = select {kind.truth} {name}.c, {numbers} {operands[1]}, {numbers} {operands[2]}",
        ]
    if operation is Operation.POWER_OF_TWO or operation is Operation.INVERSE_SQRT_ESTIMATE:
        return _bit_lines(operation, operands[0], name=name, kind=kind)
    if operation not in INTRINSICS:
        raise ValueError(f"A {operation.value} is no operation of the processor; write it out before.")
    arguments = ", ".join(f"{numbers} {operand}" for operand in operands)
    return [f"{name} = call{flags} {numbers} @llvm.{INTRINSICS[operation]}.{kind.suffix}({arguments})"]


def _bit_lines(operation: Operation, operand: str, *, name: str, kind: Kind) -> list[str]:
    """Write an operation on the bits of numbers."""

    def bits(value: int) -> str:
        return kind.constant(str(value), element="i64")

    if operation is Operation.POWER_OF_TWO:
        lines = [
            f"{name}.n = fadd {kind.numbers} {operand}, {kind.constant(literal(_TO_LAST_BITS))}",
            f"{name}.b = bitcast {kind.numbers} {name}.n to {kind.bits}",
            f"{name}.e = shl {kind.bits} {name}.b, {bits(52)}",
        ]
    else:
        lines = [
            f"{name}.b = bitcast {kind.numbers} {operand} to {kind.bits}",
            f"{name}.h = lshr {kind.bits} {name}.b, {bits(1)}",
            f"{name}.e = sub {kind.bits} {bits(INVERSE_SQRT_BITS)}, {name}.h",
        ]
    return [*lines, f"{name} = bitcast {kind.bits} {name}.e to {kind.numbers}"]
