"""The identified rig as the iteration uses it: FRF matrix and inverse, applied to whole records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from iterator.control_band import ControlBand
from spectra import as_frf, as_record, band_mask, inverse_frf, line_frequencies

FEWEST_LINES: Final = 4
"""Lines that the identified band must hold: a cubic is laid through them."""


@dataclass(frozen=True)
class RigModel:
    """FRF matrix `Ĥ` and its inverse `Ĥ†` at the lines of a block; made by `rig_model`.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Hz, from 0 to half the sample rate.
    frf : ndarray, shape (lines, n_y, n_u)
        Response unit per drive unit, e^{+jwt}; 0 outside the identified lines.
    inverse_frf : ndarray, shape (lines, n_u, n_y)
        Drive unit per response unit; 0 outside the identified lines.
    identified : slice
        Lines at which the experiment's drives had energy.
    """

    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    inverse_frf: NDArray[np.complex128]
    identified: slice

    @property
    def block_samples(self) -> int:
        """Samples of a block whose transform has the model's lines."""
        return 2 * (self.frequency.size - 1)


def rig_model(
    frequency: ArrayLike,
    frf: ArrayLike,
    *,
    identified_band: tuple[float, float],
    response_weight: ArrayLike | None = None,
) -> RigModel:
    """Make the model that a campaign starts from, with the (weighted) pseudo-inverse at each identified line.

    Parameters
    ----------
    frequency : array_like, shape (lines,)
        Hz, from 0 to half the sample rate, equally spaced.
    frf : array_like, shape (lines, n_y, n_u)
        Response unit per drive unit, `n_y >= n_u`, finite inside the identified band.
    identified_band : tuple of float
        Lowest and highest frequency with drive energy in the experiment, Hz.
    response_weight : array_like, shape (n_y,), optional
        Weight of each response in the least squares of a model with more responses than drives, greater than 0,
        usually 1 over the target's RMS. Without effect where `n_y == n_u`.

    Returns
    -------
    RigModel
        The start of a campaign.

    Raises
    ------
    ValueError
        Shapes that do not fit, fewer responses than drives, too few lines in the band, or a line inside it at which
        the FRF cannot be inverted.
    """
    estimate = np.asarray(frf, dtype=np.complex128)
    lines = np.asarray(frequency, dtype=np.float64)
    if lines.shape != estimate.shape[:1]:
        raise ValueError(
            f"The model's FRF has the shape {estimate.shape} and its frequencies {lines.shape}; both need one value "
            "for each line."
        )
    lowest, highest = identified_band
    inside = band_mask(lines, lowest, highest, edge=0.0)
    held = np.flatnonzero(inside)
    if held.size < FEWEST_LINES:
        raise ValueError(
            f"The identified band of {lowest:g} to {highest:g} Hz holds {held.size} lines of the model; at least "
            f"{FEWEST_LINES} are needed: take longer blocks or a wider band."
        )
    # Outside the band the estimate means nothing and may be anything, also not a number.
    known = inside.reshape(-1, *(1,) * (estimate.ndim - 1)) > 0.0
    matrix = as_frf(np.where(known, estimate, 0.0))
    return RigModel(
        frequency=lines,
        frf=matrix,
        inverse_frf=inverse_frf(matrix, mask=inside, frequency=lines, row_weight=response_weight),
        identified=slice(int(held[0]), int(held[-1]) + 1),
    )


def apply_inverse(model: RigModel, error: ArrayLike, *, band: ControlBand) -> NDArray[np.float64]:
    """Return the drive that makes `error` by the model: `Ĥ†` on the whole record, acausal, in the control band.

    Parameters
    ----------
    model : RigModel
        Its identified band holds the control band.
    error : array_like, shape (n_y, samples)
        Response units.
    band : ControlBand
        Drives get energy in it only.

    Returns
    -------
    ndarray, shape (n_u, samples)
        Drive units.

    Raises
    ------
    ValueError
        The record does not fit the model, or the control band passes the identified lines.
    """
    return _apply(model, model.inverse_frf, error, band=band)


def predict(model: RigModel, drive: ArrayLike, *, band: ControlBand) -> NDArray[np.float64]:
    """Return the response in the control band that the model expects of a drive, `Ŷ = Ĥ U`.

    Parameters
    ----------
    model : RigModel
        Its identified band holds the control band.
    drive : array_like, shape (n_u, samples)
        Drive units.
    band : ControlBand
        The response is predicted in it.

    Returns
    -------
    ndarray, shape (n_y, samples)
        Response units.

    Raises
    ------
    ValueError
        The record does not fit the model, or the control band passes the identified lines.
    """
    return _apply(model, model.frf, drive, band=band)


def _apply(
    model: RigModel, matrix: NDArray[np.complex128], samples: ArrayLike, *, band: ControlBand
) -> NDArray[np.float64]:
    # The flanks of a control band are narrower than the lines of a block, so the matrix is interpolated to the record's
    # own fine lines, from identified lines only. Nothing from outside the band can enter, no impulse response is cut
    # off, and the mask acts on the very lines that are played.
    record = as_record(samples)
    if record.shape[0] != matrix.shape[2]:
        raise ValueError(f"The record has {record.shape[0]} channels; the model takes {matrix.shape[2]}.")
    known = model.frequency[model.identified]
    spacing = model.frequency[1] - model.frequency[0]
    if band.lowest < known[0] - spacing or band.highest > known[-1] + spacing:
        raise ValueError(
            f"The control band of {band.lowest:g} to {band.highest:g} Hz passes the model's identified lines, "
            f"{known[0]:g} to {known[-1]:g} Hz; narrow it or identify a wider band."
        )
    count = record.shape[1]
    length = band.transform_samples(count)
    fine = line_frequencies(length, band.sample_rate)
    mask = band.drive_mask(fine)
    driven = np.flatnonzero(mask)
    # Less than one line may lie between the band's edge and the nearest identified line: its value stands in there,
    # where the mask is low; a cubic would extrapolate.
    at = np.clip(fine[driven], known[0], known[-1])
    weights = CubicSpline(known, matrix[model.identified], axis=0)(at) * mask[driven, None, None]
    spectrum = np.ascontiguousarray(np.fft.rfft(record, n=length, axis=1)[:, driven].T)
    result = np.zeros((matrix.shape[1], fine.size), dtype=np.complex128)
    result[:, driven] = np.matmul(weights, spectrum[:, :, None])[:, :, 0].T
    return np.ascontiguousarray(np.fft.irfft(result, n=length, axis=1)[:, :count])
