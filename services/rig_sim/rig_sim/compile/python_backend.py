"""Evaluate a graph operation by operation with numpy: slow, and independent of LLVM."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rig_sim.compile.operations import ARRAY_FUNCTIONS, Operation
from rig_sim.compile.scheduling import creation_order
from rig_sim.compile.tracing import Expression


def interpret(results: Sequence[Expression], inputs: Mapping[str, ArrayLike]) -> list[np.ndarray]:
    """Evaluate expressions of one graph.

    Parameters
    ----------
    results : sequence of Expression
        What to evaluate.
    inputs : mapping of str to array_like
        A number, or an array of any common shape, for each input by its name.

    Returns
    -------
    list of ndarray
        One float64 array per result.

    Raises
    ------
    ValueError
        When a needed input has no value.
    """
    values: dict[int, np.ndarray] = {}
    for expression in creation_order(results):
        if expression.operation is Operation.CONSTANT:
            values[expression.index] = np.asarray(expression.value, dtype=np.float64)
        elif expression.operation is Operation.INPUT:
            if expression.name not in inputs:
                raise ValueError(f"The input {expression.name!r} has no value; give one for every input of the graph.")
            values[expression.index] = np.asarray(inputs[expression.name], dtype=np.float64)
        else:
            operands = (values[operand.index] for operand in expression.operands)
            values[expression.index] = np.asarray(ARRAY_FUNCTIONS[expression.operation](*operands))
    return [values[result.index] for result in results]
