"""Queries about a model: prediction, convergence, levels, the difference to another one."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_loads import DAMAGE_EXPONENTS
from duralab_proto.arrays import ArrayError, from_array, from_record, to_array, to_record
from duralab_proto.v1 import array_pb2, identifier_pb2
from duralab_settings import SettingsError
from identifier.modelling import IdentifiedModel
from identifier.uncertainty import (
    CREST_FACTOR,
    LevelCheck,
    ValidBand,
    advise_levels,
    check_level,
    damage_at_levels,
    difference_sentences,
    model_difference,
    predict_convergence,
    predict_response,
)

LARGEST_CONVERGENCE_LINES: Final = 4096
"""Largest number of lines in the control band: more would keep a processor busy for minutes."""

_EXPONENT: Final = 5.0
_COLUMN: Final = DAMAGE_EXPONENTS.index(_EXPONENT)


def predict(model: IdentifiedModel, request: identifier_pb2.PredictRequest) -> identifier_pb2.Prediction:
    """Answer with the response to a drive that a model predicts.

    `model`: Model of the rig. `request`: As received, untrusted.
    Returns: Prediction as a message.
    Raises `SettingsError`: The drive does not fit the model.
    """
    drive = _record(request.drive, model.drives, model.sample_rate, field="drive")
    with np.errstate(over="ignore", invalid="ignore"):
        mapped = model.to_mapped(drive)
    if not np.all(np.isfinite(mapped)):
        raise SettingsError(
            f"The drive reaches {np.abs(drive).max():g}, of which the products in the drive map are too large for a "
            "number; give the drive in the units of the rig's drives.",
            field="drive",
        )
    found = predict_response(
        mapped,
        model.frf,
        band=model.band,
        residual_psd=model.residual_psd,
        row_covariance=model.row_covariance,
        laid=model.interpolated,
    )
    return identifier_pb2.Prediction(
        response=to_record(model.responses, model.sample_rate, found.response),
        uncertainty_rms=to_array(found.uncertainty_rms),
        share_outside_band=to_array(found.share_outside_band),
    )


def converge(
    model: IdentifiedModel, request: identifier_pb2.ConvergenceRequest, *, rig: IdentifiedModel | None
) -> identifier_pb2.Convergence:
    """Answer with the convergence of Time Waveform Replication with a model.

    `model`: Model whose inverse makes the drives. `request`: As received, untrusted. `rig`: Model that replaces the
    rig; None for `model` itself.
    Returns: Convergence as a message.
    Raises `SettingsError`: Gains or band are not allowed, one of the models is not valid in the whole band, or the two
    do not match.
    """
    gain = _array(request.iteration_gain, field="iteration_gain", shape=(len(model.responses),))
    if rig is not None:
        _check_pair(model, rig, field="rig_model_id")
    lines = _band(model, request.lowest_frequency, request.highest_frequency).lines
    if rig is not None:
        # Outside its own band a model is 0, and a rig without response would seem never to converge.
        _band(rig, request.lowest_frequency, request.highest_frequency, whose=f"that of rig model {rig.id[:12]}")
    if int(lines.sum()) > LARGEST_CONVERGENCE_LINES:
        raise SettingsError(
            f"The band holds {int(lines.sum())} lines; at most {LARGEST_CONVERGENCE_LINES} are judged: narrow it.",
            field="highest_frequency",
        )
    judge = model if rig is None else rig
    try:
        found = predict_convergence(
            model.frequency[lines],
            model.frf[lines],
            gain=gain,
            residual_psd=judge.residual_psd[lines],
            row_covariance=judge.row_covariance[lines],
            response_rms=np.sqrt(np.sum(model.response_psd[lines], axis=0)),
            rig=None if rig is None else rig.frf[lines],
        )
    except ValueError as error:
        raise SettingsError(str(error), field="iteration_gain") from error
    return identifier_pb2.Convergence(
        frequency=to_array(found.frequency),
        spectral_radius=to_array(found.spectral_radius),
        spectral_radius_95=to_array(found.spectral_radius_95),
        largest_singular_value=to_array(found.largest_singular_value),
        converging_share=found.converging_share,
        sentence=found.sentence,
    )


def drive_room(model: IdentifiedModel) -> NDArray[np.float64]:
    """Return the largest amplitude of each drive to both sides of 0.

    `model`: Model of the rig.
    Returns: Shape (drives), each in its drive's unit, greater than 0.
    Raises `ValueError`: The limits of a drive leave no room on one side.
    """
    room = np.array([min(-channel.minimum, channel.maximum) for channel in model.drives])
    for channel, free in zip(model.drives, room, strict=True):
        if not free > 0.0:
            raise ValueError(
                f"Drive {channel.name} of rig {model.rig!r} goes from {channel.minimum:g} to {channel.maximum:g} "
                f"{channel.unit}; levels need room on both sides of 0, so identify a rig with such limits."
            )
    return room


def advise(
    model: IdentifiedModel, request: identifier_pb2.AdviceRequest, *, room: NDArray[np.float64]
) -> identifier_pb2.LevelAdvice:
    """Answer with the drive levels whose responses are like a target's.

    `model`: Model of the rig. `request`: As received, untrusted. `room`: Shape (drives), greater than 0: see
    `drive_room`.
    Returns: Advice as a message.
    Raises `SettingsError`: Target, band or crest factor do not fit.
    """
    target = _record(request.target, model.responses, model.sample_rate, field="target")
    band = _band(model, request.lowest_frequency, request.highest_frequency)
    crest_factor = request.crest_factor or CREST_FACTOR
    spacing = model.frequency[1] - model.frequency[0]
    identified = np.sqrt(np.sum(model.drive_psd[band.lines], axis=0) * spacing)
    linear = identified * _level_check(model, band).largest_factor
    advice = advise_levels(
        target,
        model.frf,
        band=band,
        room=np.minimum(room, crest_factor * linear),
        crest_factor=crest_factor,
        laid=model.interpolated,
    )
    largest = room / crest_factor
    sentences = [
        f"Identify {channel.name.replace('_', ' ')} at {rms:.3g} {channel.unit} RMS"
        + (f", as far as {bound}; the target needs {wanted:.3g} {channel.unit}" if limited else "")
        + f" (this model: {present:.3g} {channel.unit})."
        for channel, rms, wanted, limited, present, bound in zip(
            model.drives,
            advice.rms,
            advice.wanted_rms,
            advice.limited,
            identified,
            np.where(linear < largest, "this model's distortion allows", "its limit allows"),
            strict=True,
        )
    ]
    damage, one_pass = None, 0.0
    if model.response_damage is not None:
        levels = np.divide(advice.rms, identified, out=np.zeros_like(identified), where=identified > 0.0)
        after = damage_at_levels(model.response_damage, model.frf, drive_psd=model.drive_psd, levels=levels)
        damage, present = after / advice.target_damage, model.response_damage / advice.target_damage
        worst = int(np.argmax(present[:, _COLUMN]))
        one_pass = float(present[worst, _COLUMN] ** (-1.0 / _EXPONENT))
        name = model.responses[worst].name.replace("_", " ")
        sentences.append(
            f"The experiment of this model did {_multiple(present[worst, _COLUMN])} times the damage of one pass of "
            f"the target (k = {_EXPONENT:g}) in {name}, the most of any response; "
            f"at {one_pass:.2g} times its levels it does one pass there, at the levels above "
            f"{_multiple(damage[:, _COLUMN].max())} in the worst response."
        )
    return identifier_pb2.LevelAdvice(
        rms=to_array(advice.rms),
        wanted_rms=to_array(advice.wanted_rms),
        largest_rms=to_array(largest),
        identified_rms=to_array(identified),
        response_ratio=to_array(advice.response_ratio),
        sentences=sentences,
        identification_damage=None if damage is None else to_array(damage),
        one_pass_factor=one_pass,
        linear_rms=to_array(advice.largest_rms),
    )


def _level_check(model: IdentifiedModel, band: ValidBand) -> LevelCheck:
    noise = None
    if model.distortion is not None:
        noise = _array(model.distortion.noise_psd, field="distortion", shape=model.residual_psd.shape)
        noise = noise / max(model.plan.periods, 1)
    return check_level(
        lines=band.lines & ~model.interpolated,
        residual_psd=model.residual_psd,
        response_psd=model.response_psd,
        random_share=np.einsum("fj,fjj->f", model.drive_psd, model.row_covariance).real,
        noise_psd=noise,
    )


def _multiple(value: float) -> str:
    """Return a multiple with three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):,.12g}"


def difference(first: IdentifiedModel, second: IdentifiedModel) -> identifier_pb2.ModelDifference:
    """Compare two models of one rig from the same lines.

    `first`, `second`: Models of the same channels and lines.
    Returns: Difference as a message.
    """
    _check_pair(first, second, field="")
    found = model_difference(
        first.frf,
        second.frf,
        drive_psd=first.drive_psd,
        first_variance=first.frf_variance,
        second_variance=second.frf_variance,
        lines=np.any(first.drive_psd > 0.0, axis=1) & first.band.lines & ~first.interpolated & ~second.interpolated,
    )
    names = [channel.name for channel in first.responses]
    return identifier_pb2.ModelDifference(
        first_id=first.id,
        second_id=second.id,
        relative_difference=to_array(found.relative),
        expected_by_noise=to_array(found.by_chance),
        sentences=difference_sentences(found, frequency=first.frequency, responses=names),
    )


def _check_pair(first: IdentifiedModel, second: IdentifiedModel, *, field: str) -> None:
    same = (
        [c.name for c in first.drives] == [c.name for c in second.drives]
        and [c.name for c in first.responses] == [c.name for c in second.responses]
        and np.array_equal(first.frequency, second.frequency)
    )
    if not same:
        raise SettingsError(
            f"Model {second.id[:12]} of rig {second.rig!r} has other channels or lines than model {first.id[:12]} of "
            f"rig {first.rig!r}; compare models of one rig with blocks of one length.",
            field=field,
        )


def _band(model: IdentifiedModel, lowest: float, highest: float, *, whose: str = "the model's") -> ValidBand:
    if not model.band.lowest <= lowest < highest <= model.band.highest:
        raise SettingsError(
            f"The band is {lowest:g} to {highest:g} Hz; it must rise and lie within {whose}, "
            f"{model.band.lowest:g} to {model.band.highest:g} Hz.",
            field="lowest_frequency",
        )
    band = ValidBand(
        lowest=lowest, highest=highest, sample_rate=model.sample_rate, block_samples=model.band.block_samples
    )
    if not band.lines.any():
        raise SettingsError(
            f"No line of the model lies from {lowest:g} to {highest:g} Hz; take a wider band.",
            field="highest_frequency",
        )
    return band


def _record(
    message: array_pb2.Record, channels: tuple[array_pb2.Channel, ...], sample_rate: float, *, field: str
) -> NDArray[np.float64]:
    try:
        given, rate, samples = from_record(message, field=field)
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
    names, wanted = [channel.name for channel in given], [channel.name for channel in channels]
    if names != wanted or rate != sample_rate or samples.shape[1] == 0:
        raise SettingsError(
            f"The {field} has {samples.shape[1]} samples of {', '.join(names)} at {rate:g} Hz; the model needs "
            f"{', '.join(wanted)} at {sample_rate:g} Hz.",
            field=field,
        )
    return samples


def _array(message: array_pb2.Array, *, field: str, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    try:
        return from_array(message, field=field, shape=shape, dtype=np.float64)
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
