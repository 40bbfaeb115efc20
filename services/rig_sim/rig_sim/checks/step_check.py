"""Check that the player's step is short enough for the stiffest motion of a rig at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from rig_sim.compile import Method, amplification
from rig_sim.specimen import Specimen

Complex = np.ndarray[Any, np.dtype[np.complex128]]

#: Factor of the fastest motion at rest for which the step must be stable: stops, progressive rubber and ends of
#: cylinders are stiffer than the position at rest.
MARGIN = 1.1
#: Growth per step that counts as none: difference errors of motions that neither grow nor decay.
_GROWTH = 1.0e-6
#: Largest stable product of step and rate: no explicit method with fewer than nine stages reaches it.
_FARTHEST = 20.0
_WALKED = 400
_BISECTIONS = 40


class StepError(ValueError):
    """Instability of the player's step, in one sentence."""


def largest_stable_step(eigenvalues: Complex, method: Method) -> float:
    """Return the longest step in s with which no decaying motion grows, including the margin.

    It is infinite if nothing moves. A motion that grows in the rig itself counts as undamped. Eigenvalues are in 1/s.
    """
    decaying = MARGIN * (np.minimum(eigenvalues.real, 0.0) + 1j * eigenvalues.imag)
    fastest = float(np.max(np.abs(decaying), initial=0.0))
    if fastest == 0.0:
        return math.inf

    def grows(step: float) -> bool:
        return bool(np.max(amplification(decaying * step, method)) > 1.0 + _GROWTH)

    # From the shortest step upwards: there may be stable steps again beyond an unstable range.
    steps = np.linspace(0.0, _FARTHEST / fastest, _WALKED + 1)
    first = next(index for index, step in enumerate(steps) if grows(step))
    stable, unstable = steps[first - 1], steps[first]
    for _ in range(_BISECTIONS):
        step = 0.5 * (stable + unstable)
        if not grows(step):
            stable = step
        else:
            unstable = step
    return stable


def check_step(linearisation: np.ndarray, *, names: Sequence[str], specimen: Specimen) -> None:
    """Check that the player's step is stable at rest.

    Raises `StepError` if a decaying motion grows in the player; names the state with the largest part in it, and a
    stable step.
    """
    longest = largest_stable_step(np.linalg.eigvals(linearisation).astype(np.complex128), specimen.integrator)
    rate, substeps = specimen.sample_rate, specimen.substeps
    step = 1.0 / (rate * substeps)
    if step <= longest:
        return
    # NumPy has no left eigenvectors. Imported here, so that a valid rig does not wait for scipy at its start.
    from scipy.linalg import eig

    values, left, right = cast(tuple[Complex, Complex, Complex], eig(linearisation, left=True))
    stiffest = int(
        np.argmin([largest_stable_step(values[[index]], specimen.integrator) for index in range(len(values))])
    )
    # Left times right eigenvector: share of a state in the motion, independent of the states' units.
    state = names[int(np.argmax(np.abs(left[:, stiffest].conj() * right[:, stiffest])))]
    raise StepError(
        f"{specimen.name}: the step of {1e3 * step:.3g} ms ({substeps} substeps) is unstable: {state!r} is too "
        f"stiff for it ({abs(values[stiffest]) / (2 * math.pi):.0f} Hz, {-values[stiffest].real:.0f} /s of damping); "
        f"up to {1e3 * longest:.3g} ms is stable, so take substeps: {math.ceil(1.0 / (rate * longest))} or soften it."
    )
