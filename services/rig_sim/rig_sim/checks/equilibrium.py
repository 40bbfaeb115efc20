"""Static equilibrium: where the rig rests with given inputs, so that a playback starts without a transient."""

from __future__ import annotations

import numpy as np

from rig_sim.checks.linearisation import Derivative, linearise
from rig_sim.model import RigModel
from rig_sim.multibody import JointKind

_LARGEST_ITERATIONS = 60
#: Of the differences that Newton's method goes by, in each state's own unit.
_STEP = 1.0e-7
#: Largest rate that counts as rest, in each state's own unit per second (m/s^2, rad/s^2, MPa/s).
_REST = 1.0e-6


class NoEquilibriumError(ValueError):
    """A rig that does not come to rest, in one sentence."""


def find_equilibrium(model: RigModel, derivative: Derivative, inputs: np.ndarray) -> np.ndarray:
    """Return the state in which nothing moves.

    `model`: Says what the states are and where to begin. `derivative`: Takes the state (states,) and the inputs
    (drives,), returns the rates (states,). `inputs`: Held constant, each in its channel's unit.
    Returns: Velocities are zero, and so is the hysteretic friction: it has no unique value at rest.
    Raises `NoEquilibriumError`: Where Newton's method from the design position ends with something still moving; names
    the state.
    """
    state = model.design_state.copy()
    free = _unknowns(model)
    trust = np.where(free < model.position_count, 0.05, 5.0)
    rates = derivative(state, inputs)
    for _ in range(_LARGEST_ITERATIONS):
        if np.max(np.abs(rates)) < _REST:
            return state
        jacobian = linearise(derivative, state, inputs, step=_STEP, columns=free)
        if not (np.all(np.isfinite(rates)) and np.all(np.isfinite(jacobian))):
            break
        # Rows differ by orders of magnitude (m/s^2 beside MPa/s); scaled rows keep the solution well conditioned. What
        # no unknown can change has a row of zeros and stays as it is.
        size = np.linalg.norm(jacobian, axis=1)
        scale = 1.0 / np.where(size > 0.0, size, 1.0)
        step = np.linalg.lstsq(jacobian * scale[:, None], -rates * scale, rcond=1.0e-13)[0]
        # A long first step would fold a linkage over: nothing moves by more than 5 cm, 3 degrees or 5 MPa at once.
        state[free] += step / max(np.max(np.abs(step) / trust), 1.0)
        _normalise_quaternions(model, state)
        rates = derivative(state, inputs)
    worst = int(np.argmax(np.where(np.isfinite(rates), np.abs(rates), np.inf)))
    raise NoEquilibriumError(
        f"the rig finds no rest: {model.state_names[worst]!r} still changes by {rates[worst]:.3g} per second after "
        f"Newton's {_LARGEST_ITERATIONS} steps or fewer; check springs, preloads and supports of the specimen."
    )


def _unknowns(model: RigModel) -> np.ndarray:
    """Positions, and the states of elements that settle; not velocities, which are zero."""
    keep = list(range(model.position_count))
    for element in model.assembly.elements:
        if element.settles:
            where = model.element_slice(element.name)
            keep += range(where.start, where.stop)
    return np.array(keep)


def _normalise_quaternions(model: RigModel, state: np.ndarray) -> None:
    for joint in model.assembly.tree.joints:
        if joint.kind is JointKind.FLOATING:
            where = slice(joint.position_start, joint.position_start + 4)
            state[where] /= np.linalg.norm(state[where])
