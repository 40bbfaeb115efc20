"""Static equilibrium of the rig with given inputs, so that a playback starts without a transient.

The linearisation at the equilibrium shows whether it is stable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from rig_sim.model import RigModel

Derivative = Callable[[np.ndarray, np.ndarray], np.ndarray]


def linearise(
    derivative: Derivative,
    state: np.ndarray,
    inputs: np.ndarray,
    *,
    step: float = 1.0e-6,
    columns: Sequence[int] | np.ndarray | None = None,
) -> np.ndarray:
    """Return the Jacobian of the rates by central differences of `step`, in each state's own unit.

    `derivative` takes state (states,) and inputs (drives,) and returns rates (states,); differentiated by all states or
    by the given `columns`.
    """
    chosen = range(len(state)) if columns is None else columns
    differences = np.empty((len(state), len(chosen)))
    for column, index in enumerate(chosen):
        ahead, behind = state.copy(), state.copy()
        ahead[index] += step
        behind[index] -= step
        differences[:, column] = (derivative(ahead, inputs) - derivative(behind, inputs)) / (2.0 * step)
    return differences


_LARGEST_ITERATIONS = 60
#: Step of the differences in Newton's method, in each state's own unit.
_STEP = 1.0e-7
#: Largest rate that counts as rest, in each state's own unit per second (m/s^2, rad/s^2, MPa/s).
_REST = 1.0e-6


class NoEquilibriumError(ValueError):
    """No equilibrium of a rig, in one sentence."""


def find_equilibrium(
    model: RigModel, derivative: Derivative, inputs: np.ndarray, *, start: np.ndarray | None = None
) -> np.ndarray:
    """Return the equilibrium under constant inputs, in each channel's unit; the search starts from the design state.

    Velocities are zero, and so is the hysteretic friction, which has no unique value at rest. Raises
    `NoEquilibriumError` if Newton's method from the design position, or `start`, does not converge; names the state.
    """
    state = (model.design_state if start is None else start).copy()
    free = _unknowns(model)
    trust = np.where(free < model.position_count, 0.05, 5.0)
    rates = derivative(state, inputs)
    for _ in range(_LARGEST_ITERATIONS):
        if np.max(np.abs(rates)) < _REST:
            return state
        jacobian = linearise(derivative, state, inputs, step=_STEP, columns=free)
        if not (np.all(np.isfinite(rates)) and np.all(np.isfinite(jacobian))):
            break
        # Rows differ by orders of magnitude (m/s^2 and MPa/s); scaled rows keep the solution well conditioned. A rate
        # that no unknown can change has a row of zeros and stays unchanged.
        size = np.linalg.norm(jacobian, axis=1)
        scale = 1.0 / np.where(size > 0.0, size, 1.0)
        step = np.linalg.lstsq(jacobian * scale[:, None], -rates * scale, rcond=1.0e-13)[0]
        # A long first step would fold a linkage over: no state changes by more than 5 cm, 3 degrees or 5 MPa at once.
        state[free] += step / max(np.max(np.abs(step) / trust), 1.0)
        model.normalise_quaternions(state)
        rates = derivative(state, inputs)
    worst = int(np.argmax(np.where(np.isfinite(rates), np.abs(rates), np.inf)))
    raise NoEquilibriumError(
        f"the rig finds no rest: {model.state_names[worst]!r} still changes by {rates[worst]:.3g} per second after "
        f"Newton's {_LARGEST_ITERATIONS} steps or fewer; check springs, preloads and supports of the specimen."
    )


def _unknowns(model: RigModel) -> np.ndarray:
    """Return the indices of positions and of settling states of elements; velocities are zero."""
    keep = list(range(model.position_count))
    for element in model.assembly.elements:
        if element.settles:
            where = model.element_slice(element.name)
            keep += range(where.start, where.stop)
    return np.array(keep)


Complex = np.ndarray[Any, np.dtype[np.complex128]]

#: Largest growth that counts as none, in 1/s: difference errors of the zeros of friction and standing tyres.
_LARGEST_GROWTH = 1.0e-2


class UnstableError(ValueError):
    """Instability of a rig at rest, in one sentence."""


def check_stability(linearisation: np.ndarray, names: Sequence[str]) -> None:
    """Raise `UnstableError` if a motion grows from rest; names the state with the largest part in it, and its rate."""
    values, vectors = cast(tuple[Complex, Complex], np.linalg.eig(linearisation))
    fastest = int(np.argmax(values.real))
    growth, turning = float(values[fastest].real), float(abs(values[fastest].imag) / (2.0 * np.pi))
    if growth <= _LARGEST_GROWTH:
        return
    state = names[int(np.argmax(np.abs(vectors[:, fastest])))]
    how = f"swings up at {turning:.3g} Hz" if turning > 0.0 else "falls away"
    raise UnstableError(
        f"the rig is unstable: from its rest, {state!r} {how}, growing e-fold in {1.0 / growth:.3g} s; check springs, "
        "preloads and control loops of the specimen."
    )
