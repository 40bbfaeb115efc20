"""Many numbers in place of one scalar of a model, which runs once for all of them in plain numpy without a trace."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np

from rig_sim.compile.operations import ARRAY_FUNCTIONS, Operation


class Many:
    """Numbers (instants,) that operators and :mod:`rig_sim.compile.numeric` take as one scalar of a model."""

    __slots__ = ("numbers",)

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers

    @staticmethod
    def apply(operation: Operation, *arguments: Any) -> Many:
        """Return the result of an operation on arguments of which at least one is many numbers."""
        plain = (argument.numbers if isinstance(argument, Many) else argument for argument in arguments)
        return Many(ARRAY_FUNCTIONS[operation](*plain))

    def __repr__(self) -> str:
        return f"Many({self.numbers!r})"

    def __add__(self, other: Any) -> Any:
        return _of(Operation.ADD, self, other)

    def __radd__(self, other: Any) -> Any:
        return _of(Operation.ADD, other, self)

    def __sub__(self, other: Any) -> Any:
        return _of(Operation.SUBTRACT, self, other)

    def __rsub__(self, other: Any) -> Any:
        return _of(Operation.SUBTRACT, other, self)

    def __mul__(self, other: Any) -> Any:
        return _of(Operation.MULTIPLY, self, other)

    def __rmul__(self, other: Any) -> Any:
        return _of(Operation.MULTIPLY, other, self)

    def __truediv__(self, other: Any) -> Any:
        return _of(Operation.DIVIDE, self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _of(Operation.DIVIDE, other, self)

    def __neg__(self) -> Many:
        return Many(-self.numbers)

    def __pos__(self) -> Many:
        return self

    def __abs__(self) -> Many:
        return Many(np.abs(self.numbers))

    def __pow__(self, exponent: float) -> Many:
        return Many(self.numbers**exponent)

    def __bool__(self) -> NoReturn:
        raise TypeError("A model cannot branch on many numbers at once; use select_positive, minimum or maximum.")

    def _compare(self, _other: object) -> NoReturn:
        raise TypeError("Many numbers cannot be compared in a model; use select_positive, minimum or maximum.")

    __lt__ = __le__ = __gt__ = __ge__ = _compare


def _of(operation: Operation, first: Any, second: Any) -> Any:
    """Return the result of two scalars; other operands are left to their own type."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return NotImplemented
    return Many.apply(operation, first, second)


def at_once(states: np.ndarray) -> np.ndarray:
    """Return rows (instants, values) as an array (values,) of many numbers each."""
    values: np.ndarray[Any, Any] = np.empty(states.shape[1], dtype=object)
    values[:] = [Many(column) for column in states.T]
    return values


def taken(values: Any, instant: int) -> np.ndarray:
    """Return the numbers of one instant from an array or sequence of scalars."""
    return np.array([value.numbers[instant] if isinstance(value, Many) else value for value in values], dtype=float)
