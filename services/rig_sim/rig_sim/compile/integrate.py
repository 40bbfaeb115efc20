"""Loop of the player: an explicit Runge-Kutta method with a fixed step, as LLVM IR.

It is in the same module as the integrated model: no second compiler, no cache on disk, no Python in the loop.
Calling it through ctypes releases the GIL.

A function of the model is expected, of ``n`` states and ``n_u`` inputs::

    void derivative(const double *state, const double *inputs, const double *constants, double *derivative,
                    double *outputs)

Outputs are computed where they are not null: at the first stage of the first step after each sample instant. The loop's
own function, one for each method, is::

    int64 play_METHOD(double *state, const double *commands, int64 command_stride, double *outputs, int64 output_stride,
               int64 samples, int64 substeps, double step, const double *bounds, const double *constants)

For several rigs in the lanes of vectors every ``double`` in an array is a vector, except in ``outputs`` of the loop:
each rig has its own rows of samples there, the rigs of one output together. The loop ends if any lane is out of bounds.

The loop adds up and compares states in vectors, so its ``state`` and ``bounds`` have room for :func:`padded` states;
those beyond the model's are 0 and in bounds.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from functools import cache
from typing import Any, Final

import numpy as np

from rig_sim.compile.llvm_text import DOUBLE, Kind, fused_lines, literal, vector_kind

Rational = Fraction | int


@dataclass(frozen=True)
class Tableau:
    """Butcher tableau of a method.

    `order`: Order of the error in the step. `nodes`: Position of each stage in the step, 0 to 1. `stages`: For each
    stage after the first, the shares of the earlier slopes. `weights`: The shares of all slopes in the step.
    """

    order: int
    nodes: tuple[Rational, ...]
    stages: tuple[tuple[Rational, ...], ...]
    weights: tuple[Rational, ...]

    def growth(self) -> tuple[Fraction, ...]:
        """Return the polynomial of rate times step, lowest power first, by which a step multiplies a linear motion.

        Its coefficients are 1, then b'A^(k-1)1; up to the order they are those of the exponential. Butcher, Numerical
        Methods for Ordinary Differential Equations, section 238.
        """
        rows = ((), *self.stages)
        reached = [Fraction(1)] * len(rows)
        coefficients = [Fraction(1)]
        for _ in rows:
            coefficients.append(sum((b * r for b, r in zip(self.weights, reached, strict=True)), Fraction(0)))
            reached = [sum((a * r for a, r in zip(row, reached, strict=False)), Fraction(0)) for row in rows]
        return tuple(coefficients)


class Method(Enum):
    """Method of a fixed step."""

    #: Classical method: 4 evaluations a step.
    RUNGE_KUTTA_4 = "runge_kutta_4"
    #: Verner's method of order 6, 7 evaluations: with steps twice as long as the classical one's it is cheaper, has a
    #: larger stable range and is more exact, if no step crosses the drive's kinks at the samples.
    VERNER_6 = "verner_6"
    #: Method of order 3 with 6 evaluations, tuned to rigs: stiff bushings and rods that a kink of friction excites
    #: decay as they should. On the shipped rigs its error is about that of Verner's with 7; no undamped motion grows.
    TUNED_3 = "tuned_3"

    @property
    def tableau(self) -> Tableau:
        """Coefficients of the method."""
        return _TABLEAUS[self]


def amplification(z: np.ndarray, method: Method) -> np.ndarray:
    """Return the factor by which one step multiplies a motion."""
    total: np.ndarray[Any, Any] = np.zeros_like(z)
    for coefficient in reversed(_growth(method)):
        total = total * z + coefficient
    return np.abs(total)


@cache
def _growth(method: Method) -> tuple[float, ...]:
    """Return the polynomial of a method in doubles: exact fractions are slow, and a search needs it a hundred times."""
    return tuple(float(coefficient) for coefficient in method.tableau.growth())


_F = Fraction
_TABLEAUS = {
    Method.RUNGE_KUTTA_4: Tableau(
        order=4,
        nodes=(0, _F(1, 2), _F(1, 2), 1),
        stages=((_F(1, 2),), (0, _F(1, 2)), (0, 0, 1)),
        weights=(_F(1, 6), _F(1, 3), _F(1, 3), _F(1, 6)),
    ),
    # Verner, Explicit Runge-Kutta Methods with Estimates of the Local Truncation Error, SIAM J. Numer. Anal. 15 (1978),
    # the pair of orders 6 and 5 known as DVERK. Its sixth stage is only for the error estimate and is left out.
    Method.VERNER_6: Tableau(
        order=6,
        nodes=(0, _F(1, 6), _F(4, 15), _F(2, 3), _F(5, 6), _F(1, 15), 1),
        stages=(
            (_F(1, 6),),
            (_F(4, 75), _F(16, 75)),
            (_F(5, 6), _F(-8, 3), _F(5, 2)),
            (_F(-165, 64), _F(55, 6), _F(-425, 64), _F(85, 96)),
            (_F(-8263, 15000), _F(124, 75), _F(-643, 680), _F(-81, 250), _F(2484, 10625)),
            (
                _F(3501, 1720),
                _F(-300, 43),
                _F(297275, 52632),
                _F(-319, 2322),
                _F(24068, 84065),
                _F(3850, 26703),
            ),
        ),
        weights=(_F(3, 40), 0, _F(875, 2244), _F(23, 72), _F(264, 1955), _F(125, 11592), _F(43, 616)),
    ),
    # Found by least squares on playbacks of the shipped rigs (decision 44). The weights have order 3 to twelve digits.
    Method.TUNED_3: Tableau(
        order=3,
        nodes=(0, _F("0.204"), _F("0.472"), _F("0.816"), _F("0.733"), _F("0.913")),
        stages=(
            (_F("0.204"),),
            (_F("-0.115"), _F("0.587")),
            (0, 0, _F("0.816")),
            (_F("0.271"), 0, _F("0.268"), _F("0.194")),
            (0, _F("0.565"), 0, 0, _F("0.348")),
        ),
        weights=(
            _F("0.077565578134"),
            _F("0.261"),
            _F("0.267"),
            _F("0.120443293460"),
            _F("0.153909042767"),
            _F("0.120082085639"),
        ),
    ),
}


COMPLETED = -1
PLAY_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int64,
    *(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64),
    *(ctypes.c_int64, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p),
)
#: Doubles in a vector of the loop for one rig: two pairs of mirrored states. With eight a playback takes 7 to 12 % more
#: time (decision 45).
SINGLE_WIDTH: Final = 4


def padded(states: int, *, rigs: int = 1, width: int = SINGLE_WIDTH) -> int:
    """Return the number of states with which the loop's vectors of `width` doubles are full."""
    together = width // rigs
    return -(-states // together) * together


def play_text(*, states: int, inputs: int, outputs: int, rigs: int = 1, width: int = SINGLE_WIDTH) -> str:
    """Write the loop for a model of these sizes, for several rigs in lanes or one, in vectors of `width` doubles."""
    kind = vector_kind(rigs)
    numbers, align = kind.numbers, ", align 8"
    entry, fraction = _spread(kind, "%fraction")
    count = padded(states, rigs=rigs, width=width) * rigs // width
    loop = _Loop(rigs, vector_kind(width), count=count, inputs=max(inputs, 1), outputs=max(outputs, 1))
    return "\n".join(
        [
            _elementwise(
                "interpolate",
                "ptr noalias %commands, i64 %stride, i64 %now, i64 %next, double %fraction, ptr noalias %inputs",
                count=inputs,
                entry=entry,
                body=f"""
  %row = mul i64 %i, %stride
  %at.now = add i64 %row, %now
  %at.next = add i64 %row, %next
  %p.now = getelementptr {numbers}, ptr %commands, i64 %at.now
  %p.next = getelementptr {numbers}, ptr %commands, i64 %at.next
  %v.now = load {numbers}, ptr %p.now{align}
  %v.next = load {numbers}, ptr %p.next{align}
  %rise = fsub {numbers} %v.next, %v.now
  %part = fmul {numbers} %rise, {fraction}
  %value = fadd {numbers} %v.now, %part
  %p = getelementptr {numbers}, ptr %inputs, i64 %i
  store {numbers} %value, ptr %p{align}""",
            ),
            _elementwise(
                "scatter",
                "ptr noalias %row, ptr noalias %outputs, i64 %stride, i64 %sample",
                count=outputs,
                body=_scattered(kind),
            ),
            loop.within(),
            *(loop.text(method) for method in Method),
        ]
    )


def _scattered(kind: Kind) -> str:
    """Write the stores of one output of a sample, for each rig into its own row."""
    lines = [
        f"  %p = getelementptr {kind.numbers}, ptr %row, i64 %i",
        f"  %value = load {kind.numbers}, ptr %p, align 8",
        f"  %first = mul i64 %i, {kind.lanes}",
    ]
    for rig in range(kind.lanes):
        one = "%value" if kind is DOUBLE else f"%value.{rig}"
        if kind is not DOUBLE:
            lines.append(f"  {one} = extractelement {kind.numbers} %value, i64 {rig}")
        lines += [
            f"  %row.{rig} = add i64 %first, {rig}",
            f"  %begin.{rig} = mul i64 %row.{rig}, %stride",
            f"  %at.{rig} = add i64 %begin.{rig}, %sample",
            f"  %q.{rig} = getelementptr double, ptr %outputs, i64 %at.{rig}",
            f"  store double {one}, ptr %q.{rig}, align 8",
        ]
    return "\n" + "\n".join(lines)


def _spread(kind: Kind, number: str) -> tuple[str, str]:
    """Return the lines that put a number into every lane, and the name of the result."""
    if kind is DOUBLE:
        return "", number
    numbers, indices = kind.numbers, kind.constant("0", element="i32")
    return (
        f"  {number}.0 = insertelement {numbers} poison, double {number}, i32 0\n"
        f"  {number}.all = shufflevector {numbers} {number}.0, {numbers} poison, <{kind.lanes} x i32> {indices}\n",
        f"{number}.all",
    )


def _elementwise(name: str, parameters: str, *, count: int, body: str, entry: str = "") -> str:
    head = f"define internal void @{name}({parameters}) alwaysinline nounwind {{"
    if count == 0:
        return f"{head}\n  ret void\n}}"
    return f"""{head}
entry:
{entry}  br label %loop
loop:
  %i = phi i64 [0, %entry], [%i.next, %loop]
{body}
  %i.next = add i64 %i, 1
  %again = icmp slt i64 %i.next, {count}
  br i1 %again, label %loop, label %end
end:
  ret void
}}"""


# Ordered comparison: a NaN is outside every bound.
_WITHIN = """
define internal i1 @within(ptr noalias %state, ptr noalias %bounds) alwaysinline nounwind {{
entry:
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%i.next, %loop]
  %so.far = phi {truth} [{yes}, %entry], [%inside, %loop]
  %p = getelementptr {numbers}, ptr %state, i64 %i
  %q = getelementptr {numbers}, ptr %bounds, i64 %i
  %value = load {numbers}, ptr %p, align 8
  %bound = load {numbers}, ptr %q, align 8
  %magnitude = call {numbers} @llvm.fabs.{suffix}({numbers} %value)
  %this = fcmp ole {numbers} %magnitude, %bound
  %inside = and {truth} %so.far, %this
  %i.next = add i64 %i, 1
  %again = icmp slt i64 %i.next, {count}
  br i1 %again, label %loop, label %end
end:
  %all = call i1 @llvm.vector.reduce.and.v{lanes}i1({truth} %inside)
  ret i1 %all
}}"""


def play_symbol(method: Method) -> str:
    """Return the name of the loop of a method."""
    return f"play_{method.value}"


class _Loop:
    """Loops of one model, one for each method."""

    def __init__(self, rigs: int, states: Kind, *, count: int, inputs: int, outputs: int) -> None:
        self._rigs = rigs
        self._states = states
        self._count = count
        self._inputs, self._outputs = inputs, outputs

    def within(self) -> str:
        """Write the comparison of all states with their bounds."""
        kind = self._states
        return _WITHIN.format(
            numbers=kind.numbers,
            truth=kind.truth,
            yes=kind.constant("true", element="i1"),
            suffix=kind.suffix,
            lanes=kind.lanes,
            count=self._count,
        )

    def text(self, method: Method) -> str:
        """Write the loop of a method."""
        tableau = method.tableau
        name = play_symbol(method)
        combinations = [
            _combination(f"{name}.to.{stage}", shares, self._states, count=self._count, contract=self._rigs == 1)
            for stage, shares in enumerate((*tableau.stages, tableau.weights), start=1)
        ]
        slopes = [f"%slope{stage}" for stage in range(len(tableau.nodes))]
        play = _PLAY.format(
            name=name,
            numbers=vector_kind(self._rigs).numbers,
            states=f"[{self._count} x {self._states.numbers}]",
            inputs=self._inputs,
            outputs=self._outputs,
            slopes="\n".join(self._slope(slope) for slope in slopes),
            stages="\n".join(self._stages(tableau, name)),
            step=_call(f"{name}.to.{len(slopes)}", tableau.weights, "%state"),
            attributes=self._states.attributes if self._rigs > 1 else "",
        )
        return "\n".join([*combinations, play])

    def _slope(self, name: str) -> str:
        """Write the memory of a slope; the model does not write what is beyond its states."""
        numbers, last = self._states.numbers, self._count - 1
        return (
            f"  {name} = alloca [{self._count} x {numbers}], align 64\n"
            f"  {name}.last = getelementptr {numbers}, ptr {name}, i64 {last}\n"
            f"  store {numbers} zeroinitializer, ptr {name}.last, align 8"
        )

    def _stages(self, tableau: Tableau, name: str) -> list[str]:
        """Write the stages after the first; commands are interpolated if the node differs from the one before."""
        lines = []
        for stage, shares in enumerate(tableau.stages, start=1):
            node = tableau.nodes[stage]
            lines.append(_call(f"{name}.to.{stage}", shares, "%point"))
            if node != tableau.nodes[stage - 1]:
                lines += [
                    f"  %number.{stage} = fadd double %number, {literal(float(node))}",
                    f"  %fraction.{stage} = fdiv double %number.{stage}, %parts",
                    "  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.next, "
                    f"double %fraction.{stage}, ptr %inputs)",
                ]
            lines.append(
                f"  call void @derivative(ptr %point, ptr %inputs, ptr %constants, ptr %slope{stage}, ptr null)"
            )
        return lines


def _call(name: str, shares: Sequence[Rational], moved: str) -> str:
    used = "".join(f"ptr %slope{stage}, " for stage, share in enumerate(shares) if share)
    return f"  call void @{name}(ptr %state, {used}double %step, ptr {moved})"


def _combination(name: str, shares: Sequence[Rational], kind: Kind, *, count: int, contract: bool) -> str:
    """Write ``moved = start + step * sum(share * slope)``; slopes without a share are not arguments.

    For one rig the compiler may fuse products and sums. In lanes they are fused here, so that every width has the same
    roundings.
    """
    used = [(stage, float(share)) for stage, share in enumerate(shares) if share]
    pointers = "".join(f"ptr noalias readonly %slope{stage}, " for stage, _ in used)
    numbers = kind.numbers
    entry, step = _spread(kind, "%step")
    lines = ["", f"  %p = getelementptr {numbers}, ptr %start, i64 %i", f"  %value = load {numbers}, ptr %p, align 8"]

    def product_and_sum(a: str, b: str, addend: str, *, number: str) -> list[str]:
        if not contract:
            return [f"  {line}" for line in fused_lines([a, b], addend, name=f"%sum{number}", kind=kind)]
        return [
            f"  %part{number} = fmul contract {numbers} {a}, {b}",
            f"  %sum{number} = fadd contract {numbers} {addend}, %part{number}",
        ]

    total = ""
    for stage, share in used:
        factor = kind.constant(literal(share))
        lines += [
            f"  %p{stage} = getelementptr {numbers}, ptr %slope{stage}, i64 %i",
            f"  %rate{stage} = load {numbers}, ptr %p{stage}, align 8",
        ]
        if total:
            lines += product_and_sum(f"%rate{stage}", factor, total, number=f"{stage}")
            total = f"%sum{stage}"
        else:
            flags = " contract" if contract else ""
            lines.append(f"  %part{stage} = fmul{flags} {numbers} %rate{stage}, {factor}")
            total = f"%part{stage}"
    lines += [
        *product_and_sum(total, step, "%value", number=".new"),
        f"  %r = getelementptr {numbers}, ptr %moved, i64 %i",
        f"  store {numbers} %sum.new, ptr %r, align 8",
    ]
    return _elementwise(
        name, f"ptr %start, {pointers}double %step, ptr %moved", count=count, body="\n".join(lines), entry=entry
    )


# Fractions of the sample are computed from the substep's number, not accumulated: only the state is carried from
# sample to sample, so chunks give the same bits as one long call.
_PLAY = """
define i64 @{name}(ptr noalias %state, ptr noalias %commands, i64 %command.stride, ptr noalias %outputs,
                   i64 %output.stride, i64 %samples, i64 %substeps, double %step,
                   ptr noalias %bounds, ptr noalias %constants) nounwind{attributes} {{
entry:
  %point = alloca {states}, align 64
{slopes}
  %inputs = alloca [{inputs} x {numbers}], align 64
  %row = alloca [{outputs} x {numbers}], align 64
  %parts = sitofp i64 %substeps to double
  br label %sample
sample:
  %k = phi i64 [0, %entry], [%k.next, %sample.end]
  %inside = call i1 @within(ptr %state, ptr %bounds)
  br i1 %inside, label %sound, label %diverged
diverged:
  ret i64 %k
sound:
  %more = icmp slt i64 %k, %samples
  br i1 %more, label %observed, label %completed
completed:
  ret i64 -1
observed:
  %k.next = add i64 %k, 1
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.next, double 0.0, ptr %inputs)
  call void @derivative(ptr %state, ptr %inputs, ptr %constants, ptr %slope0, ptr %row)
  call void @scatter(ptr %row, ptr %outputs, i64 %output.stride, i64 %k)
  br label %stages
first.stage:
  %number.begin = sitofp i64 %j.next to double
  %begin = fdiv double %number.begin, %parts
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.next, double %begin, ptr %inputs)
  call void @derivative(ptr %state, ptr %inputs, ptr %constants, ptr %slope0, ptr null)
  br label %stages
stages:
  %j = phi i64 [0, %observed], [%j.next, %first.stage]
  %number = sitofp i64 %j to double
{stages}
{step}
  %j.next = add i64 %j, 1
  %again = icmp slt i64 %j.next, %substeps
  br i1 %again, label %first.stage, label %sample.end
sample.end:
  br label %sample
}}"""
