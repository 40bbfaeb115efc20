"""The linearisation of a rig at an instant: how the rates of all states change with each state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

Derivative = Callable[[np.ndarray, np.ndarray], np.ndarray]


def linearise(
    derivative: Derivative,
    state: np.ndarray,
    inputs: np.ndarray,
    *,
    step: float = 1.0e-6,
    columns: Sequence[int] | np.ndarray | None = None,
) -> np.ndarray:
    """Return the Jacobian of the rates by central differences.

    `derivative`: Takes the state (states,) and the inputs (drives,), returns the rates (states,). `state`: Where it is
    linearised. `inputs`: Held constant, each in its channel's unit. `step`: Of the differences, in each state's own
    unit. `columns`: States to differentiate by; all where not given.
    Returns: In 1/s times the ratio of two states' units.
    """
    chosen = range(len(state)) if columns is None else columns
    differences = np.empty((len(state), len(chosen)))
    for column, index in enumerate(chosen):
        ahead, behind = state.copy(), state.copy()
        ahead[index] += step
        behind[index] -= step
        differences[:, column] = (derivative(ahead, inputs) - derivative(behind, inputs)) / (2.0 * step)
    return differences
