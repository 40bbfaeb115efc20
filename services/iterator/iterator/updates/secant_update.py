"""The secant update: every step played so far corrects the identified model, and its doubts make the step cautious."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.model import (
    IterationHistory,
    RigModel,
    StepBlocks,
    averaged_steps,
    cautious_inverse,
    driven_lines,
    seen_steps,
)
from iterator.updates import basic_twr
from iterator.updates.drive_squares import drive_for_squares
from iterator.updates.secant_fit import fit_secant
from iterator.updates.settings import NextDrive, UpdateSettings


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Fit the model to all steps played, invert it cautiously, and update the drive as in Eq. 2.

    Source: C. G. Broyden's secant condition over several steps, as a regularised least-squares fit at each line.
    """
    if not history.playbacks:
        return basic_twr.next_drive(history, model, settings)
    bent = secant_model(history, model, settings)
    start = basic_twr.step_start(history, bent, settings)
    drive = start.drive_toward(history.target, band=settings.band)
    if bent.square_frf is not None and np.any(bent.square_frf):
        drive = drive_for_squares(drive, start, square_frf=bent.square_frf, band=settings.band)
    return NextDrive(drive=drive, model=bent, stepped_from=start.drive)


def secant_model(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> RigModel:
    """Fit `H_k` and its cautious inverse to the steps of all playbacks."""
    secant = settings.secant
    weight = basic_twr.response_scale(history, model)
    lines = driven_lines(model, settings.band)
    blocks = StepBlocks(
        block_samples=model.block_samples,
        overlap=settings.secant_overlap,
        sample_rate=settings.band.sample_rate,
        first=int(lines[0]),
        last=int(lines[-1]),
        squares=settings.squares,
    )
    steps = seen_steps(history, blocks, before=model.seen_steps)
    identified = model.frf if model.identified_frf is None else model.identified_frf
    scale = _drive_scale(history, model, lines)
    fit = fit_secant(
        averaged_steps(steps, forgetting=secant.forgetting, response_weight=weight),
        identified[lines],
        identification_drive=_identification_drive(model, lines, scale),
        prior_strength=secant.prior_strength,
        response_weight=weight,
        drive_scale=scale,
        averages=blocks.independent_averages(history.target.shape[1]),
    )
    frf, inverse = identified.copy(), model.inverse_frf.copy()
    frf[lines] = fit.frf
    inverse[lines] = cautious_inverse(
        fit.frf,
        uncertainty=secant.caution * fit.uncertainty,
        regularisation=secant.regularisation,
        response_weight=weight,
        drive_scale=scale,
    )
    square = None
    if fit.square_frf is not None:
        square = np.zeros_like(identified)
        square[lines] = fit.square_frf
    return replace(model, frf=frf, inverse_frf=inverse, identified_frf=identified, seen_steps=steps, square_frf=square)


def _identification_drive(
    model: RigModel, lines: NDArray[np.intp], scale: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """`S_id` up to a factor at each line: the estimate's covariance is its inverse."""
    if model.uncertainty is None:
        return np.broadcast_to(np.diag(scale**2).astype(np.complex128), (lines.size, scale.size, scale.size))
    try:
        return np.asarray(np.linalg.inv(model.uncertainty.row_covariance[lines].conj()), dtype=np.complex128)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "The model's covariance is singular at a line of the control band; identify with as many independent "
            "experiments as drives."
        ) from error


def _drive_scale(history: IterationHistory, model: RigModel, lines: NDArray[np.intp]) -> NDArray[np.float64]:
    """RMS of the identification's drives up to a factor, or of the first drive where that is not known."""
    if model.uncertainty is None:
        scale = rms(history.playbacks[0].drive)
        if not np.all(scale > 0.0):
            return np.ones_like(scale)
        return scale
    power = np.einsum("fii->fi", _identification_drive(model, lines, np.ones(1))).real
    return np.sqrt(np.mean(power, axis=0))
