"""Whether the player's step is short enough for the stiffest motion of a rig at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, cast

import numpy as np
from scipy.linalg import eig

from rig_sim.equilibrium import Derivative

Complex = np.ndarray[Any, np.dtype[np.complex128]]

#: The step must be stable for motions this much faster than at rest: stops, progressive rubber and ends of cylinders
#: are stiffer than the rest they are met from.
MARGIN = 1.1
#: Growth per step that counts as none: what differences leave of motions that neither grow nor decay.
_GROWTH = 1.0e-6
_BISECTIONS = 40


class Stepped(Protocol):
    """What plays with a fixed step: a specimen."""

    @property
    def name(self) -> str:
        """Name of the rig."""
        ...

    @property
    def sample_rate(self) -> float:
        """In Hz."""
        ...

    @property
    def substeps(self) -> int:
        """Steps per sample."""
        ...


class StepError(ValueError):
    """A step with which the player is unstable, in one sentence."""


def amplification(z: np.ndarray) -> np.ndarray:
    """Return by how much one step of classical Runge-Kutta multiplies a motion.

    Parameters
    ----------
    z : ndarray
        Eigenvalue times step, complex, any shape.

    Returns
    -------
    ndarray
        Magnitudes; up to 1 is stable. Butcher, Numerical Methods for Ordinary Differential Equations, section 238.
    """
    return np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))


def largest_stable_step(eigenvalues: Complex) -> float:
    """Return the longest step with which no decaying motion grows, the margin included.

    Parameters
    ----------
    eigenvalues : ndarray, (n,)
        In 1/s. What grows by itself is not the step's fault and counts as undamped.

    Returns
    -------
    float
        In s; infinite where nothing moves.
    """
    decaying = MARGIN * (np.minimum(eigenvalues.real, 0.0) + 1j * eigenvalues.imag)
    fastest = float(np.max(np.abs(decaying), initial=0.0))
    if fastest == 0.0:
        return math.inf
    # The region of stability reaches to 2.79 on the real axis and 2.83 on the imaginary one, and no further than 3.
    stable, unstable = 0.0, 3.0 / fastest
    for _ in range(_BISECTIONS):
        step = 0.5 * (stable + unstable)
        if np.max(amplification(decaying * step)) <= 1.0 + _GROWTH:
            stable = step
        else:
            unstable = step
    return stable


def check_step(
    derivative: Derivative,
    rest: np.ndarray,
    inputs: np.ndarray,
    *,
    names: Sequence[str],
    specimen: Stepped,
) -> None:
    """Check that the player's step is stable at rest.

    Parameters
    ----------
    derivative : callable
        Takes the state (states,) and the inputs (drives,), returns the rates (states,).
    rest : (states,)
        Where all rates are zero.
    inputs : (drives,)
        Held constant, each in its channel's unit.
    names : sequence of str
        Of the states.
    specimen : Stepped
        Says the step.

    Returns
    -------
    None

    Raises
    ------
    StepError
        Where a motion that decays grows in the player; names the state with most of it, and the step to take.
    """
    offset = 1.0e-6
    columns = [
        (derivative(rest + shift, inputs) - derivative(rest - shift, inputs)) / (2.0 * offset)
        for shift in offset * np.eye(len(rest))
    ]
    values, left, right = cast(tuple[Complex, Complex, Complex], eig(np.array(columns).T, left=True))
    longest = largest_stable_step(values)
    rate, substeps = specimen.sample_rate, specimen.substeps
    step = 1.0 / (rate * substeps)
    if step <= longest:
        return
    stiffest = int(np.argmin([largest_stable_step(values[[index]]) for index in range(len(values))]))
    # Left times right eigenvector: a state's share in the motion, whatever the units of the states.
    state = names[int(np.argmax(np.abs(left[:, stiffest].conj() * right[:, stiffest])))]
    raise StepError(
        f"{specimen.name}: the step of {1e3 * step:.3g} ms ({substeps} substeps) is unstable: {state!r} is too "
        f"stiff for it ({abs(values[stiffest]) / (2 * math.pi):.0f} Hz, {-values[stiffest].real:.0f} /s of damping); "
        f"up to {1e3 * longest:.3g} ms is stable, so take substeps: {math.ceil(1.0 / (rate * longest))} or soften it."
    )
