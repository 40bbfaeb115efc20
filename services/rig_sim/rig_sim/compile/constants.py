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
from typing import Final

import numpy as np

from rig_sim.compile.expansion import numbers_written_out
from rig_sim.compile.tracing import TracedModel, creation_order

SYMBOL: Final = "constants"
_SLOT_BYTES: Final = 16
#: Mark of the table in an object file, as improbable there as any other 32 bytes.
_MARK: Final = hashlib.sha256(b"table of a model's constants").digest()
#: Numbers that a structure may contain, in addition to those of written-out functions.
_PLAIN: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)

Entry = int | float
"""Number of one of the model's magnitudes, from 1, with its sign; or a number that is the same in all models."""


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

    def place(self, values: Sequence[float]) -> int | None:
        """Return the byte of the table with one or two numbers; None if the code itself must hold them."""
        entries = tuple(self._entry(value) for value in values)
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


def load_text(name: str, kind: str, place: int) -> str:
    """Write the load of a table's place."""
    return f"{name} = load {kind}, ptr getelementptr (i8, ptr @{SYMBOL}, i64 {place}), align 16, !invariant.load !0"


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
