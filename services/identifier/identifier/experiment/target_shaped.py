"""Experiment at the level of a target: by a model of the rig its responses have the spectra of the target.

Strokes that excite every drive alone load some responses far more than a target does, and others far less. Where a
model of a quiet experiment is known, `shape_of` combines it with a target, `shaped_experiment` makes drives whose
predicted responses are independent and have the target's spectra, and `estimate_shaped` estimates the FRF from them.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_drive_map import DriveMap
from duralab_settings import EstimatorSettings, SettingsError, WhitePinkSpectrum
from duralab_spectra import as_record, auto_spectra, line_frequencies, rms
from identifier.estimators import FrfEstimate
from identifier.excitation import Experiment, ExperimentSettings, design_experiment, largest_excess
from identifier.experiment.estimate import estimate_experiment
from identifier.experiment.rig_under_test import RigUnderTest
from identifier.layout import Layout
from identifier.uncertainty import Prediction, ValidBand, predict_response

#: Standard deviation of the smoothing of a target's spectrum, in natural logarithms of frequency: a sixth of an octave.
_SMOOTHING: Final = np.log(2.0) / 6.0
# Least density of a target over its largest: a line without power identifies nothing.
_LEAST_DENSITY: Final = 1e-3
_OVERLAP: Final = 0.5
# Room that is left to a limit, and the most steps to find the level that leaves it: with a map it is no proportion.
_ROOM, _MOST_STEPS = 0.98, 12
# Random error of a predicted response over its level: at 1 the rig answers with 1.4 times the level. A front axle that
# friction held in the first experiment has 1 to 3, and answered with 13 times the level; one that moved has 0.1 to 0.4.
_LARGEST_UNCERTAINTY: Final = 1.0
# Share of the requested level below which the limits are too near.
_LEAST_SHARE: Final = 0.1


@dataclass(frozen=True)
class TargetShape:
    """Model, target and level of an experiment at a target.

    Parameters
    ----------
    names
        Names of the shaped responses.
    frf
        Complex, shape (lines, drives, drives): the model from mapped drives to the shaped responses, response unit per
        drive unit, at the lines of a block.
    band
        Valid band of the model.
    density
        Shape (lines, drives), response units: root of the density of each shaped response. Its RMS over the lines of
        the band is the RMS of the response.
    residual_psd, row_covariance
        Shapes (lines, drives) and (lines, drives, drives): uncertainty of the model, see `row_covariance`.
    drive_map
        Map that goes with the model; None if it was not learned.
    level
        RMS of the responses over that of the target.
    """

    names: tuple[str, ...]
    frf: NDArray[np.complex128]
    residual_psd: NDArray[np.float64]
    row_covariance: NDArray[np.complex128]
    band: ValidBand
    density: NDArray[np.float64]
    drive_map: DriveMap | None
    level: float

    def mapped(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the input of the model for a drive, shape (drives, samples)."""
        return drive if self.drive_map is None else self.drive_map.to_mapped(drive)

    def predicted(self, mapped: NDArray[np.float64]) -> Prediction:
        """Return the predicted responses to mapped drives, shape (drives, samples), in the model's band."""
        return predict_response(
            mapped, self.frf, band=self.band, residual_psd=self.residual_psd, row_covariance=self.row_covariance
        )


def shape_of(
    target: ArrayLike,
    *,
    names: tuple[str, ...],
    frf: NDArray[np.complex128],
    residual_psd: NDArray[np.float64],
    row_covariance: NDArray[np.complex128],
    band: ValidBand,
    drive_map: DriveMap | None,
    target_band: tuple[float, float],
    level: float,
) -> TargetShape:
    """Return the shape of an experiment from a model and a target.

    Parameters
    ----------
    target
        Shape (drives, samples), response units: the responses that are shaped, as many as drives; means do not count.
    names
        Names of these responses.
    frf
        Complex, shape (lines, drives, drives): the model from mapped drives to these responses.
    residual_psd, row_covariance
        Shapes (lines, drives) and (lines, drives, drives): uncertainty of these rows of the model.
    band
        Valid band of the model.
    drive_map
        Map that goes with the model; None if there is none.
    target_band
        Band of the target, in hertz. Outside it the spectrum at its edge continues.
    level
        RMS of the responses over that of the target in its band, above 0 to 1.

    Returns
    -------
    TargetShape
        Shape for an experiment with the block of the model.

    Raises
    ------
    SettingsError
        The responses are not as many as the drives, a target does not move, or the model cannot be inverted.
    """
    record = as_record(target, name="target")
    # A target as measured has a static load, which no stroke in the band makes.
    record = record - np.mean(record, axis=1, keepdims=True)
    frequency = line_frequencies(band.block_samples, band.sample_rate)
    drives = frf.shape[2]
    if record.shape[0] != drives or frf.shape[1] != drives:
        raise SettingsError(
            f"The shape has the target of {record.shape[0]} responses and the rig {drives} drives; a target-shaped "
            "experiment needs as many of both, so leave some responses out.",
            field="shape.target",
        )
    lines = band.lines
    if np.linalg.matrix_rank(frf[lines]).min() < drives:
        raise SettingsError(
            "The model of the shape cannot be inverted at every line; identify the rig again.", field="shape.model"
        )
    density = _smooth_density(record, frequency, band=band, target_band=target_band)
    size = _rms_in_band(record, target_band, sample_rate=band.sample_rate)
    if not np.all(size > 0.0):
        raise SettingsError(
            f"The target of {names[int(np.argmin(size))]} does not move in its band; give one that does for each "
            "response of the shape.",
            field="shape.target",
        )
    density *= level * size / np.sqrt(np.mean(density[lines] ** 2, axis=0))
    if not np.all(np.any(residual_psd[lines] > 0.0, axis=0)):
        raise SettingsError(
            "The model of the shape does not state how uncertain it is; identify the rig with two realisations or "
            "more, or with a local estimator.",
            field="shape.model",
        )
    return TargetShape(
        names=names,
        frf=frf,
        residual_psd=residual_psd,
        row_covariance=row_covariance,
        band=band,
        density=density,
        drive_map=drive_map,
        level=level,
    )


def _smooth_density(
    record: NDArray[np.float64], frequency: NDArray[np.float64], *, band: ValidBand, target_band: tuple[float, float]
) -> NDArray[np.float64]:
    """Return the root of the density of each row, smooth over the logarithm of frequency, shape (lines, rows)."""
    block = band.block_samples
    padded = np.pad(record, ((0, 0), (0, max(0, block - record.shape[1]))))
    density = auto_spectra(padded, block_samples=block, overlap=_OVERLAP, sample_rate=band.sample_rate)
    known = np.flatnonzero((frequency >= target_band[0]) & (frequency <= target_band[1]) & (frequency > 0.0))
    if known.size == 0:
        raise SettingsError(
            f"The band of the shape is {target_band[0]:g} to {target_band[1]:g} Hz and holds no line of the model; "
            "take a wider one.",
            field="shape.lowest_frequency",
        )
    at = np.log(np.clip(frequency, frequency[known[0]], frequency[known[-1]]))
    weight = np.exp(-0.5 * ((at[:, None] - np.log(frequency[known])) / _SMOOTHING) ** 2)
    smooth = weight @ density[known] / weight.sum(axis=1, keepdims=True)
    return np.sqrt(np.maximum(smooth, _LEAST_DENSITY * smooth.max(axis=0)))


def _rms_in_band(record: NDArray[np.float64], band: tuple[float, float], *, sample_rate: float) -> NDArray[np.float64]:
    """Return the RMS of what each row has in a band, over the whole record."""
    samples = record.shape[1]
    frequency = np.fft.rfftfreq(samples, 1.0 / sample_rate)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & (frequency > 0.0)
    power = np.abs(np.fft.rfft(record, axis=1)[:, inside]) ** 2
    return np.sqrt(2.0 * power.sum(axis=1)) / samples


def shaped_experiment(
    shape: TargetShape, settings: ExperimentSettings, *, rig: RigUnderTest
) -> tuple[Experiment, TargetShape]:
    """Make the drive of a target-shaped experiment, within the limits of the rig.

    Parameters
    ----------
    shape
        Model, target and level.
    settings
        Settings of the experiment, checked against the rig; of its spectra only the band counts, and its levels do not.
    rig
        Rig of the experiment.

    Returns
    -------
    experiment : Experiment
        Drive and layout.
    shape : TargetShape
        As given, with a lower level if the limits of the rig require it.

    Raises
    ------
    SettingsError
        The excitation is no multisine, has another block or band than the model, or fits the limits only at less than
        a tenth of the level; or the model is so uncertain that a response could be larger by far than its target.
    """
    first, drives = settings.spectra[0], len(rig.drives)
    if not settings.kind.is_multisine:
        raise SettingsError(
            f"The excitation is {settings.kind.value}; only a multisine can be shaped by a target: take "
            "random_orthogonal, or leave the experiment at the target out.",
            field="excitation.kind",
        )
    flat = WhitePinkSpectrum(
        lowest_frequency=first.lowest_frequency,
        highest_frequency=first.highest_frequency,
        corner_frequency=first.highest_frequency,
        decibels_per_octave=0.0,
    )
    settings = settings.model_copy(
        update={"spectrum": flat, "drive_spectra": (), "rms": (1.0,) * drives, "peak": None, "static_hold": 0.0}
    )
    if settings.block_samples != shape.band.block_samples:
        raise SettingsError(
            f"The estimator has blocks of {settings.block_samples} samples and the model of the shape blocks of "
            f"{shape.band.block_samples}; take the same.",
            field="estimator.block_samples",
        )
    lines = shape.band.lines
    mixing = np.zeros_like(shape.frf)
    mixing[lines] = np.linalg.inv(shape.frf[lines]) * shape.density[lines, None, :]
    made = design_experiment(settings, drives=drives, sample_rate=rig.sample_rate, mixing=mixing)
    if np.any(made.layout.excited & ~lines):
        raise SettingsError(
            f"The excitation's band is {first.lowest_frequency:g} to {first.highest_frequency:g} Hz; the model of the "
            f"shape is valid from {shape.band.lowest:g} to {shape.band.highest:g} Hz: stay within it.",
            field="excitation",
        )
    _require_certainty(shape, made.drive)
    drive, share = _within_limits(made.drive, shape, rig)
    return replace(made, drive=drive), replace(shape, level=share * shape.level, density=share * shape.density)


def _require_certainty(shape: TargetShape, mapped: NDArray[np.float64]) -> None:
    """Refuse a model by which the responses are mostly error: a larger one adds to what the rig is loaded with."""
    predicted = shape.predicted(mapped)
    ratio = predicted.uncertainty_rms / rms(predicted.response)
    worst = int(np.argmax(ratio))
    if not ratio[worst] <= _LARGEST_UNCERTAINTY:
        raise SettingsError(
            f"By the model of the shape the random error of {shape.names[worst]} is {ratio[worst]:.2g} times its level "
            f"at the target, and {_LARGEST_UNCERTAINTY:g} is allowed; identify the rig louder or longer before, or "
            "leave the experiment at the target out.",
            field="shape.model",
        )


def _within_limits(
    mapped: NDArray[np.float64], shape: TargetShape, rig: RigUnderTest
) -> tuple[NDArray[np.float64], float]:
    """Return the drive of mapped drives at the largest level within the limits, and that level over the given one."""
    share, excess, name = 1.0, np.inf, ""
    for _ in range(_MOST_STEPS):
        drive = share * mapped if shape.drive_map is None else shape.drive_map.to_drive(share * mapped)
        excess, name = largest_excess(drive, channels=rig.drives, sample_rate=rig.sample_rate)
        if excess <= 1.0:
            drive.setflags(write=False)
            return drive, share
        share *= max(_ROOM / excess, 0.5)
        if share < _LEAST_SHARE:
            break
    raise SettingsError(
        f"At {_LEAST_SHARE:g} times the level of {shape.level:g} drive {name} would still pass a limit of the rig "
        f"{excess:.3g} times; leave the experiment at the target out.",
        field="shape.level",
    )


def estimate_shaped(
    shape: TargetShape,
    settings: EstimatorSettings,
    layout: Layout,
    *,
    mapped: NDArray[np.float64],
    response: NDArray[np.float64],
) -> FrfEstimate:
    """Estimate the FRF from mapped drives to responses, using the responses that the model predicts.

    The drives of a target-shaped experiment follow each other closely; the predicted responses are independent, and the
    FRF from them to the measured ones is near the identity, so that an estimator may smooth it over lines.

    Parameters
    ----------
    shape
        Shape of the experiment.
    settings
        Settings of the estimator. A given width of a local method is for the FRF from drives: here it is chosen.
    layout
        Layout of the drive.
    mapped
        Shape (drives, samples): the whole played drive, mapped.
    response
        Shape (responses, samples), as measured.

    Returns
    -------
    FrfEstimate
        From mapped drives to responses. Its condition number is that of the predicted responses.

    Raises
    ------
    ValueError
        The records do not agree or do not identify the rig.
    """
    chosen_width = settings.model_copy(update={"local_half_width": None})
    found = estimate_experiment(chosen_width, layout, drive=shape.predicted(mapped).response, response=response)
    to_predicted = np.where(found.valid[:, None, None], shape.frf, 0.0)
    back = np.zeros_like(to_predicted)
    back[found.valid] = np.linalg.inv(shape.frf[found.valid])
    return replace(
        found,
        frf=np.matmul(found.frf, to_predicted),
        s_uu=np.matmul(np.matmul(back, found.s_uu), back.conj().transpose(0, 2, 1)),
    )
