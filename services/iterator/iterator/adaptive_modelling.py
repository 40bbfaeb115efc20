"""Adaptive Modelling: forward prediction with a diagonal correction of the inverse model after each playback."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator import basic_twr
from iterator.control_band import ControlBand
from iterator.drive_update import CorrectionSettings, NextDrive, UpdateSettings
from iterator.iteration_history import IterationHistory
from iterator.rig_model import RigModel, predict
from spectra import auto_spectra, count_blocks, paired_spectra, smooth_lines

FEWEST_BLOCKS: Final = 2
"""Blocks that a playback must hold: with a single one the coherence is 1 whatever was measured."""


@dataclass(frozen=True)
class PredictionSpectra:
    """Spectra of predicted and measured response, channel by channel.

    Parameters
    ----------
    predicted_with_measured : ndarray, shape (lines, n_y)
        `S_ŷy`, complex, unit²/Hz.
    predicted, measured : ndarray, shape (lines, n_y)
        `S_ŷŷ` and `S_yy`, unit²/Hz.
    """

    predicted_with_measured: NDArray[np.complex128]
    predicted: NDArray[np.float64]
    measured: NDArray[np.float64]


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Correct the model by the last playback, then update the drive with it as in Eq. 2.

    Parameters
    ----------
    history : IterationHistory
        Before the first playback there is nothing to learn from: the drive is that of basic TWR.
    model : RigModel
        As the previous update returned it.
    settings : UpdateSettings
        All are used.

    Returns
    -------
    NextDrive
        The drive, and the corrected model.

    Raises
    ------
    ValueError
        The playback is too short to average over, or shapes do not fit.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 12 and 13.
    """
    if not history.playbacks:
        return basic_twr.next_drive(history, model, settings)
    correction = estimate_correction(history, model, settings)
    return basic_twr.next_drive(history, corrected(model, correction), settings)


def estimate_correction(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NDArray[np.complex128]:
    """Estimate the diagonal of `C = S_ŷy S_yy⁻¹` (Eq. 12) from the last playback.

    Parameters
    ----------
    history : IterationHistory
        With one playback or more.
    model : RigModel
        Its lines are those of the correction, its `Ĥ` predicts.
    settings : UpdateSettings
        Control band and safeguards.

    Returns
    -------
    ndarray, shape (lines, n_y)
        Complex; exactly 1 outside the control band and where a line has no energy.

    Raises
    ------
    ValueError
        The playback is too short to average over.
    """
    last = history.playbacks[-1]
    block, overlap = model.block_samples, settings.correction.overlap
    if count_blocks(last.response.shape[1], block, overlap) < FEWEST_BLOCKS:
        raise ValueError(
            f"The target has {last.response.shape[1]} samples; Adaptive Modelling averages over blocks of {block} and "
            f"needs at least {FEWEST_BLOCKS} of them with {overlap:.0%} overlap: take a longer target, shorter blocks "
            "or basic TWR."
        )
    predicted = predict(model, last.drive, band=settings.band)
    rate = settings.band.sample_rate
    spectra = PredictionSpectra(
        predicted_with_measured=paired_spectra(
            predicted, last.response, block_samples=block, overlap=overlap, sample_rate=rate
        ),
        predicted=auto_spectra(predicted, block_samples=block, overlap=overlap, sample_rate=rate),
        measured=auto_spectra(last.response, block_samples=block, overlap=overlap, sample_rate=rate),
    )
    wanted = auto_spectra(history.target, block_samples=block, overlap=overlap, sample_rate=rate)
    trusted = _in_band(model, settings.band)[:, None]
    for density in (spectra.predicted, spectra.measured, wanted):
        trusted = trusted & _has_energy(density, inside=_in_band(model, settings.band), settings=settings.correction)
    return np.where(trusted, correction_from_spectra(spectra, settings.correction), 1.0)


def correction_from_spectra(spectra: PredictionSpectra, settings: CorrectionSettings) -> NDArray[np.complex128]:
    """Correction of each channel with its safeguards: `c = 1 + w (S_ŷy / S_yy - 1)`, its magnitude bounded.

    What the rig adds to the response by itself, unforeseen by the model, counts as noise in `S_yy` and biases the
    correction low. Corrections multiply, so even a mild bias would make the inverse fade away: incoherent lines are
    left alone, not just corrected less.

    Parameters
    ----------
    spectra : PredictionSpectra
        Averaged over blocks.
    settings : CorrectionSettings
        Smoothing over lines, bounds, and the weight `w = max(0, (γ² - γ₀²) / (1 - γ₀²))`, `γ₀²` the lowest coherence
        and `γ² = |S_ŷy|² / (S_ŷŷ S_yy)`.

    Returns
    -------
    ndarray, shape (lines, n_y)
        Complex; 1 at lines without any measured or predicted energy.
    """
    cross, predicted, measured = spectra.predicted_with_measured, spectra.predicted, spectra.measured
    if settings.smooth_lines:
        cross, predicted, measured = smooth_lines(cross), smooth_lines(predicted), smooth_lines(measured)
    silent = (measured <= 0.0) | (predicted <= 0.0)
    ratio: NDArray[np.complex128] = np.divide(cross, measured, out=np.ones_like(cross), where=~silent)
    if settings.weigh_by_coherence:
        coherence = np.divide(np.abs(cross) ** 2, predicted * measured, out=np.zeros_like(measured), where=~silent)
        weight = np.maximum(coherence - settings.lowest_coherence, 0.0) / (1.0 - settings.lowest_coherence)
        ratio = np.asarray(1.0 + weight * (ratio - 1.0), dtype=np.complex128)
    return _bounded(ratio, settings)


def corrected(model: RigModel, correction: NDArray[np.complex128]) -> RigModel:
    """Return the model with `Ĥ† ← Ĥ† C` (Eq. 13) and, for the next prediction, `Ĥ ← C⁻¹ Ĥ`.

    Parameters
    ----------
    model : RigModel
        Before the correction.
    correction : ndarray, shape (lines, n_y)
        Diagonal of `C`, nowhere 0.

    Returns
    -------
    RigModel
        With the same identified lines.
    """
    return replace(
        model,
        frf=model.frf / correction[:, :, None],
        inverse_frf=model.inverse_frf * correction[:, None, :],
    )


def _in_band(model: RigModel, band: ControlBand) -> NDArray[np.bool_]:
    inside = np.zeros(model.frequency.size, dtype=bool)
    inside[model.identified] = True
    return inside & (band.drive_mask(model.frequency) > 0.0)


def _has_energy(
    density: NDArray[np.float64], *, inside: NDArray[np.bool_], settings: CorrectionSettings
) -> NDArray[np.bool_]:
    largest = density[inside].max(axis=0)
    return (density > settings.energy_floor * largest) & (largest > 0.0)


def _bounded(correction: NDArray[np.complex128], settings: CorrectionSettings) -> NDArray[np.complex128]:
    magnitude = np.abs(correction)
    # A correction of exactly 0 has no phase to keep: it asks for the smallest one.
    direction = np.divide(correction, magnitude, out=np.ones_like(correction), where=magnitude > 0.0)
    inside = (magnitude >= settings.smallest) & (magnitude <= settings.largest)
    return np.where(inside, correction, np.clip(magnitude, settings.smallest, settings.largest) * direction)
