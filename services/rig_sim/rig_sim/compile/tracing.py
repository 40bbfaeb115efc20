"""Trace a model description into a graph of hash-consed expressions.

A model that is written with generic scalars runs on :class:`Expression` objects and leaves behind the operations it
consists of. Equal expressions are one node by construction, constants are folded, and what no result needs is never
emitted.
"""

import math
import struct
from typing import Any, NoReturn

import numpy as np

from rig_sim.compile.folding import simplify
from rig_sim.compile.operations import COMMUTATIVE, SCALAR_FUNCTIONS, Operation

Scalar = Any  # Expression | float | np.floating; said once, since object arrays hide it from type checkers anyway


class Expression:
    """A node of a :class:`Graph`: an operation on other nodes, a constant or an input.

    Created by operators and by :mod:`rig_sim.compile.numeric`, never directly. Equality is identity.

    Attributes
    ----------
    graph : Graph
        The graph that owns the node.
    index : int
        Position in the order of creation; operands always come before.
    operation : Operation
    operands : tuple of Expression
    value : float or None
        The number of a constant, None for all others.
    name : str
        The name of an input, empty for all others.
    """

    __slots__ = ("graph", "index", "name", "operands", "operation", "value")

    def __init__(
        self,
        graph: "Graph",
        index: int,
        operation: Operation,
        *,
        operands: tuple["Expression", ...] = (),
        value: float | None = None,
        name: str = "",
    ) -> None:
        self.graph = graph
        self.index = index
        self.operation = operation
        self.operands = operands
        self.value = value
        self.name = name

    def __repr__(self) -> str:
        if self.operation is Operation.CONSTANT:
            return repr(self.value)
        if self.operation is Operation.INPUT:
            return self.name
        return f"{self.operation.value}({', '.join(f'%{operand.index}' for operand in self.operands)})"

    def __add__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.ADD, self, other)

    def __radd__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.ADD, other, self)

    def __sub__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.SUBTRACT, self, other)

    def __rsub__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.SUBTRACT, other, self)

    def __mul__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.MULTIPLY, self, other)

    def __rmul__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.MULTIPLY, other, self)

    def __truediv__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.DIVIDE, self, other)

    def __rtruediv__(self, other: Scalar) -> "Expression":
        return self.graph.binary(Operation.DIVIDE, other, self)

    def __neg__(self) -> "Expression":
        return self.graph.apply(Operation.NEGATE, self)

    def __pos__(self) -> "Expression":
        return self

    def __abs__(self) -> "Expression":
        return self.graph.apply(Operation.ABS, self)

    def __pow__(self, exponent: float) -> "Expression":
        if isinstance(exponent, Expression) or 2 * exponent != int(2 * exponent):
            raise TypeError(f"The exponent {exponent!r} cannot be traced; give a whole number or a half of one.")
        if exponent < 0:
            return 1.0 / self**-exponent
        power = _integer_power(self, math.floor(exponent))
        return power if exponent == math.floor(exponent) else power * self.graph.apply(Operation.SQRT, self)

    def __float__(self) -> float:
        if self.value is None:
            raise TypeError(f"The traced value {self!r} has no number yet; keep it in an array with dtype=object.")
        return self.value

    def __bool__(self) -> NoReturn:
        raise TypeError(f"A model cannot branch on the traced value {self!r}; use select_positive, minimum or maximum.")

    def _compare(self, other: object) -> NoReturn:
        raise TypeError(f"The traced value {self!r} cannot be compared; use select_positive, minimum or maximum.")

    __lt__ = __le__ = __gt__ = __ge__ = _compare

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Expression):
            self._compare(other)
        return self is other

    __hash__ = object.__hash__


class Graph:
    """All expressions of one traced model, each held once.

    Constants of several isomorphic lanes will be one value per lane; only :meth:`constant`, the folding of constants
    and the literals of a backend know that a constant is a single float today.
    """

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Expression] = {}

    def __len__(self) -> int:
        return len(self._nodes)

    def constant(self, value: float) -> Expression:
        """Return the node of a finite number.

        Raises
        ------
        ValueError
            When the number is infinite or NaN.
        """
        number = float(value)
        if not math.isfinite(number):
            raise ValueError(f"The constant {number} in a traced model is not finite; give a finite number.")
        key = (Operation.CONSTANT, struct.pack("<d", number))  # by its bits: 0.0 and -0.0 differ
        node = self._nodes.get(key)
        if node is None:
            node = Expression(self, len(self._nodes), Operation.CONSTANT, value=number)
            self._nodes[key] = node
        return node

    def input(self, name: str) -> Expression:
        """Return the node of the input of this name."""
        key = (Operation.INPUT, name)
        node = self._nodes.get(key)
        if node is None:
            node = Expression(self, len(self._nodes), Operation.INPUT, name=name)
            self._nodes[key] = node
        return node

    def expression(self, value: Scalar) -> Expression:
        """Return a node of this graph for an expression or a number.

        Raises
        ------
        TypeError
            When the value is neither.
        ValueError
            When the expression belongs to another graph, or the number is not finite.
        """
        if isinstance(value, Expression):
            if value.graph is not self:
                raise ValueError(f"The traced value {value!r} belongs to another graph; trace the model as one.")
            return value
        if isinstance(value, int | float | np.floating | np.integer):
            return self.constant(float(value))
        raise TypeError(f"A {type(value).__name__} cannot be traced; give an expression or a real number.")

    def binary(self, operation: Operation, first: Scalar, second: Scalar) -> Any:
        """Apply a binary operator; leave what is no scalar (a numpy array) to the other operand's type."""
        if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
            return NotImplemented
        return self.apply(operation, first, second)

    def apply(self, operation: Operation, *arguments: Scalar) -> Expression:
        """Return the simplest node that equals the operation on these arguments (expressions or numbers)."""
        operands = tuple(self.expression(argument) for argument in arguments)
        if all(operand.value is not None for operand in operands):
            return self._folded(operation, operands)
        simplified = simplify(operation, operands)
        return self._node(operation, operands) if simplified is None else simplified

    def existing(self, operation: Operation, *operands: Expression) -> Expression | None:
        """Return the node of this operation on these operands when it was traced before."""
        return self._nodes.get((operation, *(operand.index for operand in operands)))

    def _node(self, operation: Operation, operands: tuple[Expression, ...]) -> Expression:
        if operation in COMMUTATIVE and operands[0].index > operands[1].index:
            operands = operands[::-1]
        key = (operation, *(operand.index for operand in operands))
        node = self._nodes.get(key)
        if node is None:
            node = Expression(self, len(self._nodes), operation, operands=operands)
            self._nodes[key] = node
        return node

    def _folded(self, operation: Operation, operands: tuple[Expression, ...]) -> Expression:
        numbers = tuple(operand.value for operand in operands)
        try:
            value = SCALAR_FUNCTIONS[operation](*numbers)
        except (ArithmeticError, ValueError) as error:
            raise ValueError(
                f"The constant {operation.value}{numbers} in a traced model has no finite value; correct its arguments."
            ) from error
        return self.constant(value)


def _integer_power(base: Expression, exponent: int) -> Expression:
    power = base.graph.constant(1.0)
    square = base
    while exponent:
        if exponent & 1:
            power = power * square
        exponent >>= 1
        if exponent:
            square = square * square
    return power
