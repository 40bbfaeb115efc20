"""Adaptive Modelling: the inverse model is corrected after each playback, forward or backward, diagonal or full."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_settings import CorrectionPrediction, CorrectionShape
from duralab_spectra import CrossSpectra, auto_spectra, count_blocks, paired_spectra
from iterator.model import IterationHistory, RigModel, apply_inverse, driven_lines, predict
from iterator.updates import basic_twr
from iterator.updates.model_correction import (
    FullPredictionSpectra,
    PredictionSpectra,
    correction_from_spectra,
    full_correction_from_spectra,
)
from iterator.updates.settings import NextDrive, UpdateSettings

FEWEST_BLOCKS: Final = 2
"""Smallest number of blocks in a playback: with one block the coherence is always 1."""


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Correct the model by the last playback, then update the drive with it as in Eq. 2.

    Source: Cornelis et al., ISMA 2014, Eqs. 12 and 13.
    """
    if not history.playbacks:
        return basic_twr.next_drive(history, model, settings)
    correction = estimate_correction(history, model, settings)
    return basic_twr.next_drive(history, corrected(model, correction, settings.prediction), settings)


def estimate_correction(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NDArray[np.complex128]:
    """Estimate the correction `C` from the last playback.

    Forward, `C = S_ŷy S_yy⁻¹` (Eq. 12) from the response that the model predicts to the measured one; backward,
    `C = S_uû S_ûû⁻¹` from the played drive to the one that the inverse model gives for the response.

    Parameters
    ----------
    history : IterationHistory
        History with one playback or more.
    model : RigModel
        Model with the lines of the correction; its `Ĥ` or `Ĥ†` predicts.
    settings : UpdateSettings
        Settings with the control band and safeguards.

    Returns
    -------
    ndarray, shape (lines, n) or (lines, n, n)
        Complex correction of the responses (forward) or drives (backward), diagonal or full; exactly 1 or the
        identity outside the control band and at lines without energy.

    Raises
    ------
    ValueError
        The playback is too short for an average.
    """
    last, overlap = history.playbacks[-1], settings.correction_overlap
    samples, block = last.response.shape[1], model.block_samples
    if count_blocks(samples, block, overlap) < FEWEST_BLOCKS:
        raise ValueError(
            f"The target has {samples} samples; Adaptive Modelling averages over blocks of {block} and "
            f"needs at least {FEWEST_BLOCKS} of them with {100 * overlap:.0f} % overlap: take a longer target, "
            "shorter blocks or basic TWR."
        )
    forward = settings.prediction is CorrectionPrediction.FORWARD
    if forward:
        wanted, observed = predict(model, last.drive, band=settings.band), last.response
    else:
        wanted, observed = last.drive, apply_inverse(model, last.response, band=settings.band)
    lines = driven_lines(model, settings.band)
    trusted: NDArray[np.bool_] = np.zeros((model.frequency.size, wanted.shape[0]), dtype=bool)
    trusted[lines] = True
    for record, of_pairs in ((wanted, True), (observed, True), (history.target, forward)):
        density = auto_spectra(record, block_samples=block, overlap=overlap, sample_rate=settings.band.sample_rate)
        energy = density > settings.energy_floor * density[lines].max(axis=0)
        # Backward a pair is one of drives: the target's energy cannot be assigned to a single drive.
        paired = of_pairs and settings.correction is CorrectionShape.DIAGONAL
        trusted = trusted & (energy if paired else np.all(energy, axis=1, keepdims=True))
    if settings.correction is CorrectionShape.FULL:
        full = full_correction_from_spectra(_full_spectra(wanted, observed, model=model, settings=settings), settings)
        return np.where(np.all(trusted, axis=1)[:, None, None], full, np.eye(wanted.shape[0]))
    return np.where(
        trusted,
        correction_from_spectra(_paired_spectra(wanted, observed, model=model, settings=settings), settings),
        1.0,
    )


def corrected(
    model: RigModel, correction: NDArray[np.complex128], prediction: CorrectionPrediction = CorrectionPrediction.FORWARD
) -> RigModel:
    """Return the model with `Ĥ† ← Ĥ† C` (Eq. 13) and, for the next prediction, `Ĥ ← C⁻¹ Ĥ`; backward from the left.

    Parameters
    ----------
    model : RigModel
        Model before the correction.
    correction : ndarray, shape (lines, n) or (lines, n, n)
        `C` or its diagonal, nowhere singular.
    prediction : CorrectionPrediction
        Backward: `Ĥ† ← C Ĥ†` and `Ĥ ← Ĥ C⁻¹`.

    Returns
    -------
    RigModel
        Corrected model with the same identified lines.
    """
    forward = prediction is CorrectionPrediction.FORWARD
    if correction.ndim == 2:
        of_frf = correction[:, :, None] if forward else correction[:, None, :]
        of_inverse = correction[:, None, :] if forward else correction[:, :, None]
        return replace(model, frf=model.frf / of_frf, inverse_frf=model.inverse_frf * of_inverse)
    if forward:
        frf, inverse = np.linalg.solve(correction, model.frf), np.matmul(model.inverse_frf, correction)
    else:
        frf, inverse = np.matmul(model.frf, np.linalg.inv(correction)), np.matmul(correction, model.inverse_frf)
    return replace(model, frf=np.ascontiguousarray(frf), inverse_frf=np.ascontiguousarray(inverse))


def _paired_spectra(
    wanted: NDArray[np.float64], observed: NDArray[np.float64], *, model: RigModel, settings: UpdateSettings
) -> PredictionSpectra:
    block, overlap, rate = model.block_samples, settings.correction_overlap, settings.band.sample_rate
    return PredictionSpectra(
        predicted_with_measured=paired_spectra(
            wanted, observed, block_samples=block, overlap=overlap, sample_rate=rate
        ),
        predicted=auto_spectra(wanted, block_samples=block, overlap=overlap, sample_rate=rate),
        measured=auto_spectra(observed, block_samples=block, overlap=overlap, sample_rate=rate),
    )


def _full_spectra(
    wanted: NDArray[np.float64], observed: NDArray[np.float64], *, model: RigModel, settings: UpdateSettings
) -> FullPredictionSpectra:
    averages = CrossSpectra(
        wanted.shape[0],
        observed.shape[0],
        block_samples=model.block_samples,
        overlap=settings.correction_overlap,
        sample_rate=settings.band.sample_rate,
    )
    averages.add(wanted, observed)
    found = averages.estimate()
    return FullPredictionSpectra(predicted_with_measured=found.s_ab, measured=found.s_bb, predicted=found.auto_a)
