"""Evaluate a graph operation by operation with numpy: slow, and independent of LLVM."""

import numpy as np

from rig_sim.compile.operations import ARRAY_FUNCTIONS, Operation
from rig_sim.compile.tracing import creation_order

FUNCTIONS = ARRAY_FUNCTIONS | {Operation.FUSED: lambda a, b, c: a * b + c}


def interpret(results, inputs):
    """Return a float64 array for each expression; `inputs` has a number or an array for each input by its name."""
    values = {}
    for expression in creation_order(results):
        if expression.operation is Operation.CONSTANT:
            values[expression.index] = np.asarray(expression.value, dtype=np.float64)
        elif expression.operation is Operation.INPUT:
            values[expression.index] = np.asarray(inputs[expression.name], dtype=np.float64)
        else:
            operands = (values[operand.index] for operand in expression.operands)
            values[expression.index] = np.asarray(FUNCTIONS[expression.operation](*operands))
    return [values[result.index] for result in results]
