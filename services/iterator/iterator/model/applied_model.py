"""FRF matrix and inverse applied to whole records: acausal, zero-padded, in the control band."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record
from iterator.band import ControlBand
from iterator.model.interpolated_product import InterpolatedMatrix
from iterator.model.rig import RigModel

# Sample rates with a smaller relative difference are equal except for rounding.
_SAME_RATE: Final = 1e-9


def apply_inverse(model: RigModel, error: ArrayLike, *, band: ControlBand) -> NDArray[np.float64]:
    """Return the drive that gives `error` by the model: `Ĥ†` on the whole record, acausal, in the control band.

    Parameters
    ----------
    model : RigModel
        Model whose identified band includes the control band.
    error : array_like, shape (n_y, samples)
        Record in response units.
    band : ControlBand
        Control band; drives get energy only in it.

    Returns
    -------
    ndarray, shape (n_u, samples)
        Drive in drive units.

    Raises
    ------
    ValueError
        The record does not fit the model, or the control band exceeds the identified lines.
    """
    return _apply(model, model.inverse_frf, error, band=band)


def stepped_drive(
    model: RigModel,
    target: ArrayLike,
    *,
    response: ArrayLike,
    band: ControlBand,
    stepped_from: NDArray[np.float64],
    step_gain: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return a drive plus the step that gives the missing part of the target by the model, in one pass.

    `model`: Its identified band includes the control band. `target`, shape (n_y, samples): Response units. `response`,
    shape (n_y, samples): Response that the drive already gives, response units. `band`: Band of the step's energy.
    `stepped_from`, shape (n_u, samples): The drive, drive units. `step_gain`, shape (samples,): Share of the step that
    is made at each instant; the whole step if not given.
    Returns: Drive in drive units, shape (n_u, samples).
    Raises `ValueError`: A record does not fit the model, or the control band exceeds the identified lines.
    """
    return _apply(
        model,
        model.inverse_frf,
        target,
        without=np.asarray(response),
        band=band,
        gain=step_gain,
        stepped_from=stepped_from,
    )


def drive_without(
    model: RigModel,
    addition: ArrayLike,
    *,
    by: NDArray[np.complex128],
    band: ControlBand,
    drive: NDArray[np.float64],
    step_gain: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return a drive minus the one that gives by the model what further inputs add to the responses.

    `model`: Its identified band includes the control band. `addition`, shape (inputs, samples): The further inputs, in
    their units. `by`, shape (lines, n_y, inputs): FRF of the further inputs at the model's lines, response unit per
    input unit. `band`: Band of the correction's energy. `drive`, shape (n_u, samples): Drive units. `step_gain`, shape
    (samples,): Share of the correction that is made at each instant; the whole correction if not given.
    Returns: Drive in drive units, shape (n_u, samples).
    Raises `ValueError`: A record does not fit the model, or the control band exceeds the identified lines.
    """
    correction = -np.matmul(model.inverse_frf, by)
    return _apply(model, correction, addition, band=band, gain=step_gain, stepped_from=drive)


def predict(model: RigModel, drive: ArrayLike, *, band: ControlBand) -> NDArray[np.float64]:
    """Return the response to a drive that the model predicts in the control band, `Ŷ = Ĥ U`.

    Parameters
    ----------
    model : RigModel
        Model whose identified band includes the control band.
    drive : array_like, shape (n_u, samples)
        Drive in drive units.
    band : ControlBand
        Band of the predicted response.

    Returns
    -------
    ndarray, shape (n_y, samples)
        Response in response units.

    Raises
    ------
    ValueError
        The record does not fit the model, or the control band exceeds the identified lines.
    """
    return _apply(model, model.frf, drive, band=band)


def _apply(
    model: RigModel,
    matrix: NDArray[np.complex128],
    samples: ArrayLike,
    *,
    band: ControlBand,
    without: NDArray[np.float64] | None = None,
    gain: NDArray[np.float64] | None = None,
    stepped_from: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    # The flanks of a control band are narrower than the spacing of a block's lines, so the matrix is interpolated to
    # the record's fine lines, from identified lines only. Nothing from outside the band enters, no impulse response is
    # truncated, and the mask acts on the lines that are played.
    record = as_record(samples)
    if record.shape[0] != matrix.shape[2]:
        raise ValueError(f"The record has {record.shape[0]} channels; the model takes {matrix.shape[2]}.")
    known = model.frequency[model.identified]
    spacing = model.frequency[1] - model.frequency[0]
    if abs(2.0 * model.frequency[-1] - band.sample_rate) > _SAME_RATE * band.sample_rate:
        raise ValueError(
            f"The model is for records of {2.0 * model.frequency[-1]:g} Hz and the control band for those of "
            f"{band.sample_rate:g} Hz; take both of one sample rate."
        )
    if band.lowest == 0.0 and known[0] > 0.0:
        raise ValueError(
            f"The control band begins at 0 Hz and the model's identified lines at {known[0]:g} Hz; give "
            "rig_model the static_gain, or control a band above it."
        )
    if band.lowest_driven < known[0] - spacing or band.highest_driven > known[-1] + spacing:
        raise ValueError(
            f"The control band and its flanks reach from {band.lowest_driven:g} to {band.highest_driven:g} Hz, past "
            f"the model's identified lines, {known[0]:g} to {known[-1]:g} Hz; narrow it or identify a wider band."
        )
    count = record.shape[1]
    transform = band.transform(count)
    mask = band.drive_mask(transform.frequency)
    # Less than one line spacing may lie between the band's edge and the nearest identified line, whose value is used
    # there, where the mask is low; a cubic would extrapolate.
    at = np.clip(transform.frequency, known[0], known[-1])
    spectrum = np.empty((record.shape[0], at.size), dtype=np.complex128)
    missing = np.empty(count)
    for row, samples_of_row in enumerate(record):
        np.subtract(samples_of_row, 0.0 if without is None else without[row], out=missing)
        transform.lines(missing, weight=mask, out=spectrum[row])
    made = InterpolatedMatrix(known, matrix[model.identified], at=at).times(spectrum)
    result = np.empty((matrix.shape[1], count))
    for row in range(made.shape[0]):
        transform.samples(made[row], out=result[row])
        if gain is not None:
            result[row] *= gain
        if stepped_from is not None:
            result[row] += stepped_from[row]
    return result
