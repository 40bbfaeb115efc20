"""Table of a model's constants beside its code, so that models that differ only in constants share their code.

A sweep over tolerances compiles one structure once. The code depends on the constants' values only by which of them
have equal magnitudes, by their signs, and by the places of a few numbers that the writer uses itself: all that is in
`ConstantTable.structure`, and models of one structure have the same code.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np

from rig_sim.compile.expansion import numbers_written_out
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

#: Numbers that a structure may contain, in addition to those of written-out functions.
_PLAIN: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)

Entry = int | float
"""Number of one of the constants, from 1, with its sign; or a number that is the same in all models of a structure."""


class Table(ABC):
    """Table of constants that the code of a function gets as an argument, and from which it reads one or two at a time.

    An entry is a vector with a number for each rig. Two entries that are read together lie side by side; places count
    entries.
    """

    #: Parameter of a function that reads the table.
    parameter: Final = "ptr noalias readonly %constants"

    def __init__(self, *, rigs: int) -> None:
        self._kind = "double" if rigs == 1 else f"<{rigs} x double>"
        self.entries: list[Entry] = []
        self._places: dict[tuple[str, ...], int] = {}
        self._free: int | None = None  # second half of a pair's place, so that pairs stay aligned

    @abstractmethod
    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""

    @abstractmethod
    def entry(self, constant: Expression, sign: float = 1.0) -> Entry:
        """Return the entry of a constant with a sign, 1 or -1."""

    def load_lines(self, name: str, kind: str, place: int) -> list[str]:
        """Write the load of one or two entries."""
        return [
            f"{name}.p = getelementptr {self._kind}, ptr %constants, i64 {place}",
            f"{name} = load {kind}, ptr {name}.p, align 8",
        ]

    def place(self, entries: Sequence[Entry]) -> int:
        """Return the place of one or two entries."""
        key = tuple(map(repr, entries))  # the number 1 is another entry than the first constant
        if key not in self._places:
            self._places[key] = self._new_place(entries)
        return self._places[key]

    def _new_place(self, entries: Sequence[Entry]) -> int:
        if len(entries) == 1 and self._free is not None:
            place, self._free = self._free, None
            self.entries[place] = entries[0]
            return place
        place = len(self.entries)
        self.entries += entries
        if len(entries) == 1:
            self._free = place + 1
            self.entries.append(0.0)
        return place


class ConstantTable(Table):
    """Table of the constants of one traced model.

    `structure`: Digest of the model without the values of its constants. `complete`: Whether the table has no number
    computed from constants of the model, so that other models of the structure can use the code.
    """

    def __init__(self, traced: TracedModel) -> None:
        super().__init__(rigs=1)
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

    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        return expression.value is not None

    def entry(self, constant: Expression, sign: float = 1.0) -> Entry:
        """Return the entry of a constant with a sign, 1 or -1."""
        value = sign * float(constant)
        number = self._magnitudes.get(abs(value))
        if number is not None:
            return -number if value < 0.0 else number
        if abs(value) not in _written():
            self.complete = False
        return value

    def content(self, entries: Sequence[Entry]) -> np.ndarray:
        """Return the table (entries,) with the values of this model; raises ValueError if it lacks such constants."""
        values = list(self._magnitudes)
        table = np.empty(len(entries))
        for place, entry in enumerate(entries):
            if isinstance(entry, float):
                table[place] = entry
            elif 1 <= abs(entry) <= len(values):
                table[place] = np.copysign(values[abs(entry) - 1], entry)
            else:
                raise ValueError(f"a table of constants names number {entry} of {len(values)}")
        return table


class LaneTable(Table):
    """Table of the constants of united variants, for several rigs in lanes."""

    def __init__(self, constants: Sequence[Expression], *, rigs: int) -> None:
        super().__init__(rigs=rigs)
        self._numbers = {leaf.index: number for number, leaf in enumerate(constants, start=1)}

    def holds(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        return expression.value is not None or expression.index in self._numbers

    def entry(self, constant: Expression, sign: float = 1.0) -> Entry:
        """Return the entry of a constant with a sign, 1 or -1."""
        if constant.value is not None:
            return sign * constant.value
        return int(sign) * self._numbers[constant.index]

    def content(self, values: np.ndarray) -> np.ndarray:
        """Return the table (entries, rigs) of the constants' values (constants, rigs)."""
        rows = np.empty((len(self.entries), values.shape[1]))
        for row, entry in zip(rows, self.entries, strict=True):
            row[:] = entry if isinstance(entry, float) else np.copysign(1.0, entry) * values[abs(entry) - 1]
        return rows


@cache
def _written() -> frozenset[float]:
    """Return the magnitudes that the code itself contains."""
    return frozenset((*numbers_written_out(), *_PLAIN))
