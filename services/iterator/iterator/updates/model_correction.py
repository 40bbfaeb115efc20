"""Corrections of the inverse model from averaged spectra, with safeguards: channel by channel, or full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import smooth_lines
from iterator.updates.settings import UpdateSettings

LARGEST_CONDITION: Final = 1e8
"""Condition number of the observed spectra, scaled to unit diagonal, above which a line gets no full correction."""


@dataclass(frozen=True)
class PredictionSpectra:
    """Spectra of predicted and measured signal, channel by channel.

    `predicted_with_measured`, shape (lines, n): `S_ŷy`, complex, unit²/Hz; backward `S_uû`. `predicted`, `measured`,
    shape (lines, n): `S_ŷŷ` and `S_yy`, unit²/Hz; backward `S_uu` and `S_ûû`.
    """

    predicted_with_measured: NDArray[np.complex128]
    predicted: NDArray[np.float64]
    measured: NDArray[np.float64]


@dataclass(frozen=True)
class FullPredictionSpectra:
    """Spectra of predicted and measured signal, of all channels with each other.

    `predicted_with_measured`, shape (lines, n, n): `S_ŷy`; backward `S_uû`. `measured`, shape (lines, n, n): `S_yy`;
    backward `S_ûû`. `predicted`, shape (lines, n): Diagonal of `S_ŷŷ`; backward of `S_uu`.
    """

    predicted_with_measured: NDArray[np.complex128]
    measured: NDArray[np.complex128]
    predicted: NDArray[np.float64]


def correction_from_spectra(spectra: PredictionSpectra, settings: UpdateSettings) -> NDArray[np.complex128]:
    """Return the correction of each channel with safeguards: `c = 1 + w (S_ŷy / S_yy - 1)`, its magnitude bounded.

    Responses of the rig that the model does not predict count as noise in `S_yy` and bias the correction low.
    Corrections multiply, so even a small bias would make the inverse vanish: incoherent lines are not corrected at all,
    not only corrected less.
    """
    cross, predicted, measured = spectra.predicted_with_measured, spectra.predicted, spectra.measured
    if settings.smooth_lines:
        cross, predicted, measured = smooth_lines(cross), smooth_lines(predicted), smooth_lines(measured)
    silent = (measured <= 0.0) | (predicted <= 0.0)
    ratio: NDArray[np.complex128] = np.divide(cross, measured, out=np.ones_like(cross), where=~silent)
    if settings.weigh_by_coherence:
        coherence = np.divide(np.abs(cross) ** 2, predicted * measured, out=np.zeros_like(measured), where=~silent)
        ratio = np.asarray(1.0 + _weight(coherence, settings) * (ratio - 1.0), dtype=np.complex128)
    return _bounded(ratio, settings)


def full_correction_from_spectra(spectra: FullPredictionSpectra, settings: UpdateSettings) -> NDArray[np.complex128]:
    """Return the full correction `C = S_ŷy S_yy⁻¹` (Eq. 12) with safeguards."""
    cross, measured, predicted = spectra.predicted_with_measured, spectra.measured, spectra.predicted
    if settings.smooth_lines:
        cross, measured, predicted = smooth_lines(cross), smooth_lines(measured), smooth_lines(predicted)
    lines, n = predicted.shape
    auto = np.einsum("fii->fi", measured).real
    result = np.broadcast_to(np.eye(n, dtype=np.complex128), (lines, n, n)).copy()
    alive = np.flatnonzero(np.all((auto > 0.0) & (predicted > 0.0), axis=1))
    level = np.sqrt(auto[alive])
    scaled = measured[alive] / level[:, :, None] / level[:, None, :]
    sound = np.linalg.cond(scaled) <= LARGEST_CONDITION
    lines_kept, level, scaled = alive[sound], level[sound], scaled[sound]
    found = cross[lines_kept] / level[:, :, None] / level[:, None, :]
    ratio = np.linalg.solve(scaled.transpose(0, 2, 1), found.transpose(0, 2, 1)).transpose(0, 2, 1)
    if settings.weigh_by_coherence:
        explained = np.einsum("fij,fij->fi", ratio, found.conj()).real
        coherence = np.clip(explained * level**2 / predicted[lines_kept], 0.0, 1.0)
        ratio = np.eye(n) + _weight(coherence, settings)[:, :, None] * (ratio - np.eye(n))
    left, singular, right = np.linalg.svd(ratio)
    beyond = np.any((singular < settings.smallest_correction) | (singular > settings.largest_correction), axis=1)
    bounded = np.clip(singular[beyond], settings.smallest_correction, settings.largest_correction)
    ratio[beyond] = np.matmul(left[beyond] * bounded[:, None, :], right[beyond])
    result[lines_kept] = ratio * level[:, :, None] / level[:, None, :]
    return result


def _weight(coherence: NDArray[np.float64], settings: UpdateSettings) -> NDArray[np.float64]:
    return np.maximum(coherence - settings.lowest_coherence, 0.0) / (1.0 - settings.lowest_coherence)


def _bounded(correction: NDArray[np.complex128], settings: UpdateSettings) -> NDArray[np.complex128]:
    magnitude = np.abs(correction)
    # A correction of exactly 0 has no phase: it becomes the smallest allowed one.
    direction = np.divide(correction, magnitude, out=np.ones_like(correction), where=magnitude > 0.0)
    inside = (magnitude >= settings.smallest_correction) & (magnitude <= settings.largest_correction)
    return np.where(
        inside, correction, np.clip(magnitude, settings.smallest_correction, settings.largest_correction) * direction
    )
