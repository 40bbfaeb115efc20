"""Table of a model's constants beside its code, so that models that differ only in constants share their code.

A sweep over tolerances compiles one structure once. The code depends on the constants' values only by which of them
have equal magnitudes, by their signs, and by the places of a few numbers that the writer uses itself: all that is in
`ConstantTable.structure`, and models of one structure have the same code.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from functools import cache
from typing import Final, Protocol

import numpy as np

from rig_sim.compile.expansion import numbers_written_out
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

SYMBOL: Final = "constants"
_SLOT_BYTES: Final = 16
#: Mark of the table in an object file, as improbable there as any other 32 bytes.
_MARK: Final = hashlib.sha256(b"table of a model's constants").digest()
#: Numbers that a structure may contain, in addition to those of written-out functions.
_PLAIN: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)

Entry = int | float
"""Number of one of the model's magnitudes, from 1, with its sign; or a number that is the same in all models."""

Term = tuple[Expression, float]
"""Constant of a model and its sign, 1 or -1."""


class Constants(Protocol):
    """Table of constants from which the code of a function reads one or two at a time."""

    @property
    def parameters(self) -> Sequence[str]:
        """Parameters of a function that reads the table."""
        ...

    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        ...

    def place(self, terms: Sequence[Term]) -> int | None:
        """Return the place of one or two constants; None if the code itself must hold them."""
        ...

    def load_lines(self, name: str, kind: str, place: int) -> list[str]:
        """Write the load of a place."""
        ...


class ConstantTable:
    """Table of the constants of one traced model; the writers of its code request places in it.

    `structure`: Digest of the model without the values of its constants. `complete`: Whether the code holds no number
    computed from constants of the model, so that other models of the structure can use it.
    """

    def __init__(self, traced: TracedModel) -> None:
        results = (*traced.derivative, *traced.outputs)
        nodes = creation_order((*traced.state, *traced.inputs, *results))
        magnitudes: dict[float, int] = {}
        # The mirror of two sides is searched with constants of ten digits.
        rounded: dict[str, int] = {f"{number:.9e}": place for place, number in enumerate(sorted(_written()))}
        digest = hashlib.sha256()
        places = {node.index: place for place, node in enumerate(nodes)}
        for node in nodes:
            if node.value is None:
                operands = " ".join(str(places[operand.index]) for operand in node.operands)
                said = f"{node.operation.value} {node.name} {operands}"
            elif abs(node.value) in _written():
                said = node.value.hex()
            else:
                magnitude = abs(node.value)
                alike = rounded.setdefault(f"{magnitude:.9e}", len(rounded))
                sign = "-" if node.value < 0.0 else ""
                said = f"constant {sign}{magnitudes.setdefault(magnitude, len(magnitudes) + 1)} {alike}"
            digest.update(f"{said}\n".encode())
        for group in (traced.state, traced.inputs, traced.derivative, traced.outputs):
            digest.update(f"{[places[expression.index] for expression in group]}\n".encode())
        self.structure = digest.hexdigest()
        self.complete = True
        self._magnitudes = magnitudes
        self._slots: dict[tuple[Entry, ...], int] = {}

    @property
    def slots(self) -> list[list[Entry]]:
        """Content of each place, one or two numbers in 16 bytes."""
        return [list(entries) for entries in self._slots]

    @property
    def parameters(self) -> Sequence[str]:
        """None: the table is part of the module."""
        return ()

    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        return expression.value is not None

    def place(self, terms: Sequence[Term]) -> int | None:
        """Return the byte of the table with one or two constants; None if the code itself must hold them."""
        entries = tuple(self._entry(sign * float(expression)) for expression, sign in terms)
        if all(isinstance(entry, float) for entry in entries):
            return None
        return len(_MARK) + _SLOT_BYTES * self._slots.setdefault(entries, len(self._slots))

    def _entry(self, value: float) -> Entry:
        number = self._magnitudes.get(abs(value))
        if number is not None:
            return -number if value < 0.0 else number
        if abs(value) not in _written():
            self.complete = False
        return value

    def load_lines(self, name: str, kind: str, place: int) -> list[str]:
        """Write the load of a place."""
        address = f"getelementptr (i8, ptr @{SYMBOL}, i64 {place})"
        return [f"{name} = load {kind}, ptr {address}, align 16, !invariant.load !0"]

    def text(self) -> str:
        """Write the table with the model's own values."""
        content = _MARK + self.content(self.slots)
        numbers = (f"double 0x{number:016X}" for (number,) in struct.iter_unpack("<Q", content))
        # Not an LLVM constant, whose value would be inlined; the loads declare that it is never written.
        return (
            f"@{SYMBOL} = dso_local global [{len(content) // 8} x double] [{', '.join(numbers)}], align 64\n"
            "!0 = !{}\n"
        )

    def content(self, slots: Sequence[Sequence[Entry]]) -> bytes:
        """Return a table with the values of this model; raises ValueError if it lacks such constants."""
        values = list(self._magnitudes)
        table = np.zeros((len(slots), 2))
        for row, entries in zip(table, slots, strict=True):
            for lane, entry in enumerate(entries):
                if isinstance(entry, float):
                    row[lane] = entry
                elif 1 <= abs(entry) <= len(values):
                    row[lane] = np.copysign(values[abs(entry) - 1], entry)
                else:
                    raise ValueError(f"a table of constants names number {entry} of {len(values)}")
        return table.tobytes()


class LaneTable:
    """Table of the constants of rigs in lanes, which a function gets as an argument: vectors of a number of each rig.

    A pair of constants lies side by side. Places count vectors.
    """

    def __init__(self, constants: Sequence[Expression], *, rigs: int) -> None:
        self._numbers = {leaf.index: number for number, leaf in enumerate(constants, start=1)}
        self._rigs = rigs
        self._entries: list[Entry] = []
        self._places: dict[tuple[Entry, ...], int] = {}
        self._free: int | None = None  # second half of a pair's place, so that pairs stay aligned

    @property
    def parameters(self) -> Sequence[str]:
        """Parameter of a function that reads the table."""
        return ("ptr noalias readonly %constants",)

    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        return expression.value is not None or expression.index in self._numbers

    def place(self, terms: Sequence[Term]) -> int | None:
        """Return the place of one or two constants; None if they are the same in all rigs."""
        entries = tuple(self._entry(expression, sign) for expression, sign in terms)
        if all(isinstance(entry, float) for entry in entries):
            return None
        if entries not in self._places:
            self._places[entries] = self._new_place(entries)
        return self._places[entries]

    def _entry(self, expression: Expression, sign: float) -> Entry:
        if expression.value is not None:
            return sign * expression.value
        return int(sign) * self._numbers[expression.index]

    def _new_place(self, entries: tuple[Entry, ...]) -> int:
        if len(entries) == 1 and self._free is not None:
            place, self._free = self._free, None
            self._entries[place] = entries[0]
            return place
        place = len(self._entries)
        self._entries += entries
        if len(entries) == 1:
            self._free = place + 1
            self._entries.append(0.0)
        return place

    def load_lines(self, name: str, kind: str, place: int) -> list[str]:
        """Write the load of a place."""
        return [
            f"{name}.p = getelementptr <{self._rigs} x double>, ptr %constants, i64 {place}",
            f"{name} = load {kind}, ptr {name}.p, align 8",
        ]

    def content(self, values: np.ndarray) -> np.ndarray:
        """Return the table (vectors, rigs) of the constants' values (constants, rigs)."""
        rows = np.empty((len(self._entries), values.shape[1]))
        for row, entry in zip(rows, self._entries, strict=True):
            row[:] = entry if isinstance(entry, float) else np.copysign(1.0, entry) * values[abs(entry) - 1]
        return rows


def with_constants(code: bytes, content: bytes) -> bytes:
    """Return an object file with other numbers in its table; raises ValueError unless it has exactly one table."""
    begin = code.find(_MARK)
    if begin < 0 or code.find(_MARK, begin + 1) >= 0 or begin + len(_MARK) + len(content) > len(code):
        raise ValueError("its code has no table of constants of that size")
    begin += len(_MARK)
    return code[:begin] + content + code[begin + len(content) :]


@cache
def _written() -> frozenset[float]:
    """Return the magnitudes that the code itself contains."""
    return frozenset((*numbers_written_out(), *_PLAIN))
