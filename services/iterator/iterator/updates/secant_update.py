"""Secant update: all played steps correct the identified model, and its uncertainty makes the step cautious."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.model import (
    ODD_TERMS,
    SPEED_TERMS,
    DriveTerm,
    IterationHistory,
    RigModel,
    SeenStep,
    StepBlocks,
    StepSpectra,
    WholeRecords,
    averaged_steps,
    cautious_inverse,
    driven_lines,
    equivalent_drive,
    seen_steps,
    speed_of_lines,
)
from iterator.updates import basic_twr
from iterator.updates.drive_squares import drive_for_squares
from iterator.updates.foresight import foreseen_steps, kept_inputs, terms_that_foresee
from iterator.updates.gains import gain_at
from iterator.updates.gauss_newton import StepProblem, gauss_newton_step
from iterator.updates.rate_limits import (
    FittedRig,
    RateLimits,
    drive_within_rate_limits,
    find_rate_limits,
    large_errors,
)
from iterator.updates.secant_fit import PRIOR_OF_TERM, MatrixAndSpread, SecantFit, fit_secant
from iterator.updates.settings import NextDrive, UpdateSettings

# Strength of the identified model relative to `prior_strength` if odd terms are fitted: they explain the effect of the
# level on the drives' own columns, and a strong prior prevents that.
_PRIOR_WITH_TERMS: Final = 0.3
# Prior strength of terms of speeds: the two of a drive resemble each other, and its speed.
_PRIOR_OF_SPEED: Final = 0.1


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Fit the model to all steps played, invert it cautiously, and update the drive as in Eq. 2.

    If nonlinear terms of the drives predict the playbacks better than the drives alone, the step includes them: squares
    by fixed point iteration; odd terms and those of speeds by least squares of the error that the fitted model
    predicts. If limits of actuators explain what the playbacks lack, the model is fitted to what the actuators did, and
    the step is within the limits.

    Source: C. G. Broyden's secant condition over several steps, as a regularised least-squares fit at each line; C. F.
    Gauss and I. Newton for the step.
    """
    if not basic_twr.playbacks_before(history, model):
        return basic_twr.next_drive(history, model, settings)
    step = _step(history, model, settings)
    bent, drive, limits = step.rig.model, step.drive, ()
    # A limit of drives that are divided by their level is another one where the level changes.
    if settings.secant.rate_limits and len(history.playbacks) > 1:
        large = large_errors(history, step.rig, start=step.start)
        limits = find_rate_limits(history, step.rig, start=step.start, large=large)
        if any(limits) and large.any():
            moved = _step(
                _moved_history(history, limits, sample_rate=settings.band.sample_rate, where=large), model, settings
            )
            drive = drive_within_rate_limits(
                moved.drive, limits, moved.rig, moved_from=moved.start.drive, played=step.start, large=large
            )
            # Spectra of steps are kept for the next update, which begins with those of the drives played.
            bent = replace(moved.rig.model, seen_steps=bent.seen_steps, foreseen_steps=bent.foreseen_steps)
    return NextDrive(drive=drive, model=replace(bent, rate_limits=limits), stepped_from=step.start.drive)


@dataclass(frozen=True)
class _Step:
    """Start of a step, the rig that it was made with, and the drive that it leads to."""

    start: basic_twr.StepStart
    rig: FittedRig
    drive: NDArray[np.float64]


def _step(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> _Step:
    """Fit the rig to the steps played, and make the next one."""
    learned = _learned(history, model, settings)
    rig, bent = learned.rig, learned.rig.model
    start = basic_twr.step_start(history, bent, settings)
    if not set(bent.terms) & {*ODD_TERMS, *SPEED_TERMS}:
        drive = start.drive_toward(history.target, band=settings.band)
        if bent.term_frf is not None and np.any(bent.term_frf):
            drive = drive_for_squares(drive, start, square_frf=bent.term_frf, band=settings.band)
        return _Step(start, rig, drive)
    problem = StepProblem(
        bent,
        lines=rig.lines,
        frf=learned.fit.frf,
        uncertainty=rig.uncertainty,
        regularisation=rig.regularisation,
        response_weight=rig.response_weight,
        drive_scale=rig.drive_scale,
        drive=start.drive,
        band=settings.band,
    )
    gain = gain_at(problem.frequency, settings, playbacks=basic_twr.playbacks_before(history, model))
    step = gauss_newton_step(problem, missing=history.target - start.response, gain=gain)
    return _Step(start, rig, start.drive + start.share * step)


def _moved_history(
    history: IterationHistory, limits: RateLimits, *, sample_rate: float, where: NDArray[np.bool_]
) -> IterationHistory:
    """Return the history with drives that move the actuators as those played did, if they had no limits."""
    playbacks = tuple(
        replace(each, drive=equivalent_drive(each.drive, limits, sample_rate=sample_rate, where=where))
        for each in history.playbacks
    )
    return replace(history, playbacks=playbacks)


def secant_model(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> RigModel:
    """Fit `H_k` and its cautious inverse to the steps of all playbacks."""
    return _learned(history, model, settings).rig.model


@dataclass(frozen=True)
class _Learned:
    """Rig corrected by all steps, and the fit of the correction at the driven lines, in scaled units."""

    rig: FittedRig
    fit: SecantFit


def _learned(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> _Learned:
    secant = settings.secant
    weight = basic_twr.response_scale(history, model)
    lines = driven_lines(model, settings.band)
    candidates = _candidates(settings)
    blocks = StepBlocks(
        block_samples=model.block_samples,
        overlap=settings.secant_overlap,
        sample_rate=settings.band.sample_rate,
        first=int(lines[0]),
        last=int(lines[-1]),
        terms=tuple(dict.fromkeys(term for terms in candidates for term in terms)),
    )
    steps = seen_steps(history, blocks, before=model.seen_steps, earlier=model.earlier)
    identified = model.frf if model.identified_frf is None else model.identified_frf
    scale = _drive_scale(history, model, lines)
    identification_drive = _identification_drive(model, lines, scale)
    records = WholeRecords(model, identified) if secant.whole_record else None
    blocks_averaged = blocks.independent_averages(history.target.shape[1])
    # Of the first steps, by their number: each candidate is fitted to the same ones.
    averaged: dict[int, StepSpectra] = {}
    of_drives: dict[tuple[int, float], MatrixAndSpread] = {}

    def fit(steps: tuple[SeenStep, ...], terms: tuple[DriveTerm, ...], prior_strength: float) -> SecantFit:
        if len(steps) not in averaged:
            average = averaged_steps if records is None else records.averaged
            averaged[len(steps)] = average(steps, forgetting=secant.forgetting, response_weight=weight)
        fitted_with = len(steps), prior_strength
        found = fit_secant(
            averaged[len(steps)].of_inputs(kept_inputs(steps[0].blocks.terms, terms, drives=scale.size)),
            identified[lines],
            identification_drive=identification_drive,
            prior_strength=prior_strength,
            response_weight=weight,
            drive_scale=scale,
            averages=blocks_averaged if records is None else records.averages(steps, forgetting=secant.forgetting),
            further_prior=np.repeat([_prior_of(term) for term in terms], scale.size),
            of_drives=of_drives.get(fitted_with),
        )
        of_drives[fitted_with] = found.of_drives
        return found

    weaker = _PRIOR_WITH_TERMS * secant.prior_strength
    foreseen = foreseen_steps(
        steps,
        candidates,
        fit=lambda before, terms: fit(before, terms, weaker),
        settings=secant,
        response_weight=weight,
        before=model.foreseen_steps,
    )
    terms = terms_that_foresee(foreseen, candidates, settings=secant)
    prior_strength = weaker if set(terms) & set(ODD_TERMS) else secant.prior_strength
    found = fit(steps, terms, prior_strength)
    frf, inverse = identified.copy(), model.inverse_frf.copy()
    frf[lines] = found.frf
    if history.playbacks:
        speed = speed_of_lines(model.frequency[lines], sample_rate=settings.band.sample_rate)
        frf[lines] += _mean_slope(found, terms, history.playbacks[-1].drive, speed=speed)
    uncertainty = secant.caution * found.uncertainty
    inverse[lines] = cautious_inverse(
        found.frf,
        uncertainty=uncertainty[:, : scale.size, : scale.size],
        regularisation=secant.regularisation,
        response_weight=weight,
        drive_scale=scale,
    )
    term_frf = None
    if terms:
        term_frf = np.zeros((*identified.shape[:2], found.term_frf.shape[2]), dtype=np.complex128)
        term_frf[lines] = found.term_frf
    bent = replace(
        model,
        frf=frf,
        inverse_frf=inverse,
        identified_frf=identified,
        seen_steps=steps,
        terms=terms,
        term_frf=term_frf,
        foreseen_steps=foreseen,
    )
    rig = FittedRig(
        bent,
        lines=lines,
        uncertainty=uncertainty,
        regularisation=secant.regularisation,
        response_weight=weight,
        drive_scale=scale,
        band=settings.band,
    )
    return _Learned(rig, found)


def _mean_slope(
    found: SecantFit, terms: tuple[DriveTerm, ...], drive: NDArray[np.float64], *, speed: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return the contribution of terms to the FRF around a drive, averaged over time: predictions are linear.

    Even terms are left out: their slopes are positive as often as negative, and have no mean except by chance.
    """
    added = np.zeros_like(found.frf)
    for number, term in enumerate(terms):
        if term in ODD_TERMS or term is DriveTerm.SIGNED_ROOT_OF_SPEED:
            columns = slice(number * drive.shape[0], (number + 1) * drive.shape[0])
            slope = found.term_frf[:, :, columns] * np.mean(term.slopes(term.argument(drive)), axis=1)
            added += speed[:, None, None] * slope if term.is_of_speed else slope
    return added


def _prior_of(term: DriveTerm) -> float:
    """Return the prior strength of a term."""
    return _PRIOR_OF_SPEED if term.is_of_speed else PRIOR_OF_TERM


def _candidates(settings: UpdateSettings) -> tuple[tuple[DriveTerm, ...], ...]:
    """Return the sets of terms that may be fitted: the first is empty."""
    squares = (DriveTerm.SQUARE,) if settings.squares else ()
    odd = ODD_TERMS if settings.secant.odd_terms else ()
    speeds = squares + SPEED_TERMS if settings.secant.speed_terms else ()
    return tuple(dict.fromkeys(((), squares, odd, squares + odd, speeds)))


def _identification_drive(
    model: RigModel, lines: NDArray[np.intp], scale: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return `S_id` up to a factor at each line: the estimate's covariance is its inverse."""
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
    """Return the RMS of the identification's drives up to a factor, or of the first drive if that is not known."""
    if model.uncertainty is None:
        scale = rms((*model.earlier, history.playbacks)[0][0].drive)
        if not np.all(scale > 0.0):
            return np.ones_like(scale)
        return scale
    power = np.einsum("fii->fi", _identification_drive(model, lines, np.ones(1))).real
    return np.sqrt(np.mean(power, axis=0))
