"""Shorter machine code of a long function: what it addresses is near a register.

An instruction of x86-64 takes one byte for a distance of 128 bytes from a register, and four for any other distance. A
model's function has some thousand accesses to a stack of some kilobytes, but computes with vector registers only: the
other registers are pointed at what is used next. Operations, their order and the addresses stay the same.
"""

from __future__ import annotations

import platform
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

IS_POSSIBLE: Final = platform.machine() == "x86_64"
"""Whether the code of this processor is of this kind."""

#: Has the compiler save the registers that a function must not change, so that they are free inside.
FREES_REGISTERS: Final = 'call void asm sideeffect "", "~{rbx},~{rbp},~{r12},~{r13},~{r14},~{r15}"()'

_CALLERS: Final = ("rax", "r9", "r10", "r11")
_POINTERS: Final = ("rsp", "rdi", "rsi", "rdx", "rcx", "r8")
_ACCESS: Final = re.compile(r"(-?\d*)\(%(\w+)\)")
_CHANGES_STACK: Final = re.compile(r"\s+(push|pop|call|ret|leave|enter)|.*, *%rsp$")
#: Instructions that change no register but the one they name last.
_INSTRUCTION: Final = re.compile(r"\s+(v|k|mov|lea|test|cmp|j|nop)\w*")
#: Vectors that need a longer form of an instruction, which counts distances in lengths of the vector.
_LONG_FORM: Final = re.compile(r"zmm|\{|[xy]mm(?:1[6-9]|2\d|3[01])")
#: Bytes of a cell of memory, and the cells that a register reaches before, and from, where it points.
_CELL: Final = 16
_REACH: Final = 8
#: Number of next accesses by which a register is given its place, and how many of them it must gain there: pointing it
#: takes as many bytes as three of them save. Of 50 to 1000 and 3 to 8 these gave some of the shortest code.
_AHEAD: Final = 100
_WORTH: Final = 6

Cell = tuple[str, int]


def shortened(assembly: str, function: str) -> str:
    """Return the assembly of a module with shorter addresses in one function; unchanged where that is not safe."""
    lines = [line.partition("#")[0].rstrip() for line in assembly.split("\n")]
    if f"{function}:" not in lines:
        return assembly
    begin = lines.index(f"{function}:")
    end = next(place for place in range(begin, len(lines)) if lines[place].startswith(".Lfunc_end"))
    first, last = _body(lines, begin, end)
    body = lines[first:last]
    instructions = [line for line in body if re.match(r"\s+[^\s.]", line)]
    if not all(_INSTRUCTION.match(line) for line in instructions):
        return assembly
    registers = _free_registers(instructions, lines[begin:first])
    changed = {match[1] for line in instructions if (match := re.search(r", *%(\w+)$", line))}
    steady = [name for name in _POINTERS if name not in changed]
    return "\n".join([*lines[:first], *_addressed(body, registers, steady), *lines[last:]])


def _body(lines: Sequence[str], begin: int, end: int) -> tuple[int, int]:
    """Return the longest part of a function in which the stack stays where it is."""
    changes = [begin, *(place for place in range(begin, end) if _CHANGES_STACK.match(lines[place])), end]
    before, after = max(pairwise(changes), key=lambda part: part[1] - part[0])
    return before + 1, after


def _free_registers(instructions: Iterable[str], before: Sequence[str]) -> list[str]:
    """Return the registers that the body does not use, and whose value is saved if the function must keep it."""
    used = {name for line in instructions for name in re.findall(r"%(\w+)", line)}
    saved = {match[1] for line in before if (match := re.match(r"\s+pushq\s+%(\w+)", line))}
    if any(re.match(r"\s+movq\s+%rsp, *%rbp", line) for line in before):
        saved.discard("rbp")  # It holds the place of the stack.
    return [name for name in (*_CALLERS, *sorted(saved)) if not used & _names(name)]


def _names(register: str) -> set[str]:
    """Return the names of a register and of its parts."""
    short = register[1:]
    return {register, f"{register}d", f"{register}w", f"{register}b", f"e{short}", short, f"{short[0]}l", f"{short}l"}


def _addressed(body: Sequence[str], registers: Sequence[str], steady: Sequence[str]) -> list[str]:
    """Return the lines of a body with registers that point near what is used next."""
    found = [None if _LONG_FORM.search(line) else _ACCESS.search(line) for line in body]
    far = [
        (match[2], int(match[1] or 0)) if match and match[2] in steady and not _is_near(int(match[1] or 0)) else None
        for match in found
    ]
    places = _Places(registers, [(base, at // _CELL) for base, at in filter(None, far)])
    lines: list[str] = []
    for line, access in zip(body, far, strict=True):
        if re.match(r"\S", line):
            places.forget()  # A label: other ways lead here.
        register = None if access is None else places.next_register(lines)
        if access is None or register is None:
            lines.append(line)
        else:
            lines.append(_ACCESS.sub(f"{access[1] - places.start(register)}(%{register})", line, count=1))
    return lines


def _is_near(distance: int) -> bool:
    return -_REACH * _CELL <= distance < _REACH * _CELL


class _Places:
    """Where registers point, from one access to the next.

    `cells`: Cells of all accesses in their order.
    """

    def __init__(self, registers: Sequence[str], cells: Sequence[Cell]) -> None:
        self._registers = registers
        self._cells = cells
        self._number = 0
        self._near = Counter(cells[:_AHEAD])
        self._places: dict[str, Cell] = {}

    def forget(self) -> None:
        """Point nowhere."""
        self._places.clear()

    def start(self, register: str) -> int:
        """Return the distance of where a register points from its base, in bytes."""
        return self._places[register][1] * _CELL

    def next_register(self, lines: list[str]) -> str | None:
        """Return a register near the next access; add the line that points it there if none was."""
        base, cell = self._cells[self._number]
        register = next((name for name, place in self._places.items() if _reaches(place, (base, cell))), None)
        if register is None and (register := self._point_to(base, cell)) is not None:
            lines.append(f"\tleaq\t{self.start(register)}(%{base}), %{register}")
        self._near[base, cell] -= 1
        if self._number + _AHEAD < len(self._cells):
            self._near[self._cells[self._number + _AHEAD]] += 1
        self._number += 1
        return register

    def _point_to(self, base: str, cell: int) -> str | None:
        """Point a register to the best place that reaches a cell; None if no place is worth it."""
        best = max(((base, cell + by) for by in range(1 - _REACH, _REACH + 1)), key=self._reached)
        free = next((name for name in self._registers if name not in self._places), None)
        if free is None and self._places:
            free = min(self._places, key=lambda name: self._reached(self._places[name]))
        if free is None or self._reached(best) - self._reached(self._places.get(free)) < _WORTH:
            return None
        self._places[free] = best
        return free

    def _reached(self, place: Cell | None) -> int:
        """Return the number of next accesses that a register reaches from a place."""
        if place is None:
            return 0
        return sum(self._near[place[0], near] for near in range(place[1] - _REACH, place[1] + _REACH))


def _reaches(place: Cell, access: Cell) -> bool:
    return place[0] == access[0] and -_REACH <= access[1] - place[1] < _REACH
