"""Mathematics for models that run both traced and plain.

Every function takes expressions, floats or float arrays: one expression among the arguments traces the operation;
plain floats go to the C library; arrays, and many numbers as one scalar, go to numpy. Compiled code has the functions
written out (:mod:`rig_sim.compile.expansion`), equal to a few units in the last place, and without the sign of a zero.
"""

from functools import partial
from typing import Any

import numpy as np

from rig_sim.compile.many import Many
from rig_sim.compile.operations import ARRAY_FUNCTIONS, SCALAR_FUNCTIONS, Operation
from rig_sim.compile.tracing import Expression, Scalar


def _evaluate(operation: Operation, *arguments: Scalar) -> Any:
    for argument in arguments:
        if isinstance(argument, Expression):
            return argument.graph.apply(operation, *arguments)
    if any(isinstance(argument, Many) for argument in arguments):
        return Many.apply(operation, *arguments)
    if any(isinstance(argument, np.ndarray) for argument in arguments):
        return ARRAY_FUNCTIONS[operation](*arguments)
    return SCALAR_FUNCTIONS[operation](*arguments)


sqrt = partial(_evaluate, Operation.SQRT)
#: One over the square root of a number above 0; in the lanes of vectors by products alone, without division and root.
inverse_sqrt = partial(_evaluate, Operation.INVERSE_SQRT)
tanh = partial(_evaluate, Operation.TANH)
exp = partial(_evaluate, Operation.EXP)
absolute = partial(_evaluate, Operation.ABS)
#: Functions of an angle in rad, and inverses: the angle with the sine x, -π/2 to π/2; of the point (y, x), -π to π.
sin = partial(_evaluate, Operation.SIN)
cos = partial(_evaluate, Operation.COS)
asin = partial(_evaluate, Operation.ASIN)
atan2 = partial(_evaluate, Operation.ATAN2)
#: NaN if one of two values is NaN.
minimum = partial(_evaluate, Operation.MINIMUM)
maximum = partial(_evaluate, Operation.MAXIMUM)
#: Arguments (condition, positive, negative): ``positive`` if ``condition >= 0`` (also for -0.0), else ``negative``,
#: also for NaN. Both are always evaluated: guard a square root by ``sqrt(maximum(x, 0.0))``, not by this selection.
select_positive = partial(_evaluate, Operation.SELECT_POSITIVE)


def clamp(x: Scalar, lowest: Scalar, highest: Scalar) -> Any:
    """Return x limited to ``lowest`` … ``highest``; NaN stays NaN."""
    return minimum(maximum(x, lowest), highest)
