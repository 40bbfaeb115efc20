"""Whether a rig that rests would stay there: the eigenvalues of its linearisation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

Complex = np.ndarray[Any, np.dtype[np.complex128]]

#: Largest growth that counts as none, in 1/s: what differences leave of the zeros of friction and standing tyres.
_LARGEST_GROWTH = 1.0e-2


class UnstableError(ValueError):
    """A rig that leaves its rest by itself, in one sentence."""


def check_stability(linearisation: np.ndarray, names: Sequence[str]) -> None:
    """Check that nothing grows from the rest.

    `linearisation`: Rates by states at rest, in 1/s times the ratio of two states' units. `names`: Of the states.
    Raises `UnstableError`: Where a motion grows; names the state with most of it, and how fast.
    """
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
