"""Gate of the nonlinear terms: they are used while they predict the playbacks better than the drives alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_settings import SecantSettings
from iterator.model import ODD_TERMS, DriveTerm, ForeseenStep, SeenStep, StepSpectra, averaged_steps
from iterator.updates.secant_fit import SecantFit

# Share of the energy left by a smaller set of terms, below which a larger set has to stay to be used.
_GATE: Final = 0.9
# The same for the first step, which no fit could predict: an arc leaves a tenth, a false one far more. A fit to the
# lines of whole records leaves less without arcs, too, see decision 41.
_GATE_OF_FIRST, _GATE_OF_FIRST_RECORD = 0.5, 0.7
# Share of the energy below which the prediction is complete: rounding residue says nothing about terms.
_ALL_FORESEEN: Final = 1e-6

FitSteps = Callable[[tuple[SeenStep, ...], tuple[DriveTerm, ...]], SecantFit]
"""Function that fits the drives and some terms to steps."""


def foreseen_steps(
    steps: tuple[SeenStep, ...],
    candidates: Sequence[tuple[DriveTerm, ...]],
    *,
    fit: FitSteps,
    settings: SecantSettings,
    response_weight: NDArray[np.float64],
    before: tuple[ForeseenStep, ...],
) -> tuple[ForeseenStep, ...]:
    """Predict every step with each candidate's terms, fitted to the steps before it; the first step from itself.

    `before`: Result of an earlier call; its steps would be identical, byte for byte.
    """
    fitted_with = (settings, tuple(candidates), response_weight.tobytes())
    found: list[ForeseenStep] = []
    for number, step in enumerate(steps):
        known = before[number] if number < len(before) else None
        if known is None or known.step is not step or known.fitted_with != fitted_with:
            before = ()
            spectra = averaged_steps(
                (step,), forgetting=1.0, response_weight=response_weight, each_line=settings.whole_record
            )
            energy = float(np.sum(spectra.response @ response_weight**2))
            earlier = steps[: max(number, 1)]
            left = tuple(_left(spectra, step, fit(earlier, terms), terms) @ response_weight**2 for terms in candidates)
            shares = tuple(float(np.sum(each)) / energy if energy > 0.0 else 0.0 for each in left)
            known = ForeseenStep(step, fitted_with, shares)
        found.append(known)
    return tuple(found)


def _left(spectra: StepSpectra, step: SeenStep, found: SecantFit, terms: tuple[DriveTerm, ...]) -> NDArray[np.float64]:
    kept = kept_inputs(step.blocks.terms, terms, drives=found.frf.shape[2])
    return spectra.of_inputs(kept).unexplained(np.concatenate((found.frf, found.term_frf), axis=2))


def terms_that_foresee(
    foreseen: tuple[ForeseenStep, ...], candidates: Sequence[tuple[DriveTerm, ...]], *, settings: SecantSettings
) -> tuple[DriveTerm, ...]:
    """Return the candidate that predicts the steps best: from the smallest, a larger one only if it leaves far less.

    One step is not enough evidence: the drives alone may predict a step that a model with terms has made better than
    others, and the gate would flutter. Each step therefore has `φ` times the weight of the one after it, and a used
    set is dropped only for one that leaves less. After the first playback there is no prediction: squares have to
    explain most of it, and odd terms, which resemble the drives, would only replace the part that the prior
    withholds.
    """
    used, gate_of_first = 0, _GATE_OF_FIRST_RECORD if settings.whole_record else _GATE_OF_FIRST
    for number in range(1, len(foreseen) + 1):
        steps = foreseen[1:number] or foreseen[:1]
        count = np.array([settings.forgetting**age for age in reversed(range(len(steps)))])
        left = count @ np.array([step.left for step in steps]) / np.sum(count)
        used = int(np.argmin(left[: used + 1]))
        for larger in range(used + 1, len(candidates)):
            if number == 1 and set(candidates[larger]) & set(ODD_TERMS):
                continue
            if left[larger] < (_GATE if number > 1 else gate_of_first) * left[used] and left[used] > _ALL_FORESEEN:
                used = larger
    return candidates[used]


def kept_inputs(cut: tuple[DriveTerm, ...], terms: tuple[DriveTerm, ...], *, drives: int) -> NDArray[np.intp]:
    """Return the indices of the drives and of some terms among the inputs of the steps."""
    blocks = (0, *(1 + cut.index(term) for term in terms))
    return np.concatenate([np.arange(drives) + drives * block for block in blocks])
