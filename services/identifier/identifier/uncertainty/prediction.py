"""Prediction of a model for a drive, with uncertainty."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record
from identifier.uncertainty.valid_band import ValidBand


@dataclass(frozen=True)
class Prediction:
    """Predicted response of a model to a drive, in the model's band.

    `response`: Shape (responses, samples), without static part. `uncertainty_rms`: Shape (responses): RMS of its error
    by the random errors of the FRF, in the response's unit. `share_outside_band`: Shape (drives): share of each drive's
    power, 0 to 1, that is outside the band and left out; neither power includes its mean.
    """

    response: NDArray[np.float64]
    uncertainty_rms: NDArray[np.float64]
    share_outside_band: NDArray[np.float64]


def predict_response(
    drive: ArrayLike,
    frf: NDArray[np.complex128],
    *,
    band: ValidBand,
    residual_psd: NDArray[np.float64],
    row_covariance: NDArray[np.complex128],
    laid: NDArray[np.bool_] | None = None,
) -> Prediction:
    """Apply a model to a drive, ``Y = H U`` at the lines of the whole record.

    Parameters
    ----------
    drive
        Shape (drives, samples), at the model's sample rate; taken as zero outside.
    frf
        Complex, shape (lines, responses, drives).
    band
        Valid band of the model.
    residual_psd, row_covariance
        Shapes (lines, responses) and (lines, drives, drives): covariance of the model's rows, see `row_covariance`.
    laid
        Shape (lines): lines of the FRF that were interpolated, not estimated. None: no such lines.

    Returns
    -------
    Prediction
        Prediction with as many samples as the drive.

    Raises
    ------
    ValueError
        The drive has other channels than the model.

    Notes
    -----
    Between the model's lines the FRF is interpolated by a cubic spline, covariance and residual linearly; the lines
    must be close enough for its resonances. Source: the forward prediction of Cornelis et al., ISMA 2014, section 3.
    """
    record = as_record(drive, name="drive")
    drives = frf.shape[2]
    if record.shape[0] != drives:
        raise ValueError(f"The drive has {record.shape[0]} channels; the model has {drives} drives.")
    count = record.shape[1]
    moving = record - np.mean(record, axis=1, keepdims=True)
    # The response continues after the drive; one more block of zeros keeps its end from wrapping to the start.
    length = count + band.block_samples
    spectrum = np.fft.rfft(moving, n=length, axis=1)
    frequency = np.arange(spectrum.shape[1]) * (band.sample_rate / length)
    inside = band.contains(frequency)
    matrix = band.curved_between_lines(frf, frequency[inside], laid=laid)
    result = np.zeros((frf.shape[1], frequency.size), dtype=np.complex128)
    result[:, inside] = np.einsum("fij,jf->if", matrix, spectrum[:, inside])
    response = np.fft.irfft(result, n=length, axis=1)[:, :count]

    power = np.abs(spectrum) ** 2
    total = np.sum(power, axis=1)
    outside = np.divide(np.sum(power[:, ~inside], axis=1), total, out=np.zeros_like(total), where=total > 0.0)
    covariance = band.between_lines(row_covariance, frequency[inside])
    residual = band.between_lines(residual_psd, frequency[inside])
    played = spectrum[:, inside].T
    # E|d u|^2 = S_ee u^T R conj(u), twice for the negative frequencies, over the record by Parseval.
    each = np.einsum("fj,fjk,fk->f", played, covariance, played.conj()).real
    variance = 2.0 * (each @ residual) / (length * count)
    return Prediction(
        response=np.ascontiguousarray(response), uncertainty_rms=np.sqrt(variance), share_outside_band=outside
    )
