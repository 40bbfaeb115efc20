"""Build of a model from request, playback and estimate, with its plan, warnings and verdicts."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_loads import channel_damage
from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, rig_pb2
from identifier.estimators import FrfEstimate, ModelWarning, WarningCode
from identifier.excitation import ExperimentSettings, plan_experiment
from identifier.experiment import RigUnderTest, StaticGain, TargetShape, static_samples, static_warnings, with_names
from identifier.layout import Layout
from identifier.modelling.line_filling import fill_lines, valid_band
from identifier.modelling.model import IdentifiedModel, with_id
from identifier.uncertainty import (
    DistortionLevels,
    ValidBand,
    can_separate,
    check_level,
    distortion_shares,
    has_other_phases,
    level_sentence,
    noise_shares,
    separate_distortion,
    separated_verdicts,
    unexplained_shares,
    unexplained_verdicts,
    unknown_verdicts,
)

_WARNING_CODES: Final = {
    WarningCode.CLIPPED: identifier_pb2.MODEL_WARNING_CODE_CLIPPED,
    WarningCode.TRANSIENT: identifier_pb2.MODEL_WARNING_CODE_TRANSIENT_LEFT,
    WarningCode.FEW_AVERAGES: identifier_pb2.MODEL_WARNING_CODE_FEW_AVERAGES,
    WarningCode.SMOOTHED: identifier_pb2.MODEL_WARNING_CODE_SMOOTHED,
    WarningCode.STUCK: identifier_pb2.MODEL_WARNING_CODE_STUCK,
    WarningCode.STATIC_GAIN: identifier_pb2.MODEL_WARNING_CODE_STATIC_GAIN,
}


def plan_message(settings: ExperimentSettings, *, rig: RigUnderTest, band: ValidBand) -> identifier_pb2.ExperimentPlan:
    """Return duration and results of an experiment as a message.

    `settings`: Checked against the rig. `rig`: Rig of the experiment. `band`: Valid band of its model.
    Returns: Plan as a message.
    """
    plan = plan_experiment(settings, drives=len(rig.drives), sample_rate=rig.sample_rate)
    holds = static_samples(settings, drives=len(rig.drives), sample_rate=rig.sample_rate)
    return identifier_pb2.ExperimentPlan(
        duration_seconds=plan.duration_seconds + holds / rig.sample_rate,
        samples=plan.samples + holds,
        realisations=plan.realisations,
        experiments_per_realisation=plan.experiments_per_realisation,
        periods=plan.periods,
        delay_share=plan.delay_seconds_share,
        blocks=plan.blocks,
        independent_averages=plan.independent_averages,
        frequency_resolution=plan.frequency_resolution,
        lines=plan.lines,
        lowest_frequency=band.lowest,
        highest_frequency=band.highest,
    )


def model_of(
    request: identifier_pb2.IdentifyRequest,
    *,
    settings: ExperimentSettings,
    rig: RigUnderTest,
    layout: Layout,
    estimate: FrfEstimate,
    static: StaticGain | None,
    played: rig_pb2.PlayResult,
    response: NDArray[np.float64],
    levels: DistortionLevels | None,
    drive_map: identifier_pb2.DriveMap | None = None,
) -> IdentifiedModel:
    """Build the model message from the request, the record and the estimates.

    `request`: The query. `settings`: Its settings, parsed. `rig`: Description of the rig. `layout`: That of the drive.
    `estimate`, `static`: Estimates from the playback. `played`: Result of the playback, for its epoch and number of
    signal blocks. `response`: Measured responses (responses, samples). `levels`: Result of `distortion_of`.
    `drive_map`: Drive map learned from the same record, or None if none was requested.
    Returns the model with its id.
    """
    filled, band = fill_lines(estimate), valid_band(layout)
    warnings = (*estimate.warnings, *static_warnings(static, estimate, hold=settings.static_hold))
    names = [channel.name for channel in rig.responses]
    if levels is not None:
        transients = [warning.channel for warning in estimate.warnings if warning.code is WarningCode.TRANSIENT]
        unsettled = {channel for channel in transients if channel is not None}
        verdicts = separated_verdicts(levels, responses=names, unsettled=unsettled)
    elif not has_other_phases(layout) or not np.any(estimate.degrees_of_freedom > 0.0):
        verdicts = unknown_verdicts(responses=names)
    else:
        shares = unexplained_shares(
            estimate.frequency,
            lines=estimate.valid,
            residual_psd=estimate.unexplained_psd,
            response_psd=estimate.response_psd,
        )
        verdicts = unexplained_verdicts(shares, responses=names)
    return with_id(
        IdentifiedModel(
            rig=rig.name,
            drives=rig.drives,
            responses=rig.responses,
            sample_rate=rig.sample_rate,
            frequency=estimate.frequency,
            frf=filled.frf,
            coherence=filled.coherence,
            condition_number=filled.condition_number,
            residual_psd=filled.residual_psd,
            row_covariance=filled.row_covariance,
            interpolated=filled.interpolated,
            band=band,
            drive_psd=estimate.drive_psd,
            response_psd=estimate.response_psd,
            excitation=request.excitation,
            estimator=request.estimator,
            blocks=estimate.blocks,
            independent_averages=estimate.independent_averages,
            rig_content_hash=rig.content_hash,
            run=request.run,
            signal_epoch=played.epoch,
            signal_blocks=played.blocks,
            plan=plan_message(settings, rig=rig, band=band),
            warnings=(
                *(_warning(warning, rig) for warning in warnings),
                *_level_warnings(estimate, rig=rig, levels=levels),
                *(
                    identifier_pb2.ModelWarning(code=identifier_pb2.MODEL_WARNING_CODE_OTHER, sentence=sentence)
                    for sentence in played.warnings
                ),
            ),
            static_gain=None if static is None else static.gain,
            static_change=None if static is None else static.unsettled,
            verdicts=verdicts,
            distortion=None if levels is None else _distortion(levels),
            drive_map=drive_map,
            response_damage=channel_damage(response),
        )
    )


def with_shape(
    model: IdentifiedModel, shape: TargetShape, *, after: IdentifiedModel, wanted_level: float
) -> IdentifiedModel:
    """Return the model of a target-shaped experiment with what it takes from the model that shaped it.

    `model`: From `model_of`. `shape`: As played. `after`: Model of the experiment before. `wanted_level`: Requested.
    Returns: Model whose damage is that of both experiments, and with the static gain of the first one.
    """
    damage = None
    if model.response_damage is not None and after.response_damage is not None:
        damage = model.response_damage + after.response_damage
    warnings = model.warnings
    if shape.level < wanted_level:
        sentence = (
            f"The limits of rig {model.rig!r} hold the experiment at the target to {shape.level:.2g} of the target's "
            f"RMS; {wanted_level:g} were requested."
        )
        lower = identifier_pb2.ModelWarning(code=identifier_pb2.MODEL_WARNING_CODE_OTHER, sentence=sentence)
        warnings = (*warnings, lower)
    return with_id(
        replace(
            model,
            id="",
            warnings=warnings,
            response_damage=damage,
            static_gain=after.static_gain,
            static_change=after.static_change,
            shaped_by=after.id,
            target_level=shape.level,
        )
    )


def distortion_of(drive: NDArray[np.float64], response: NDArray[np.float64], layout: Layout) -> DistortionLevels | None:
    """Separate noise and distortion if the experiment allows it.

    `drive`: Shape (drives, samples), as played. `response`: Shape (responses, samples), as measured. `layout`: Layout
    of the drive.
    Returns: None if the experiment does not allow it.
    """
    return separate_distortion(drive, response, layout) if can_separate(layout, drives=drive.shape[0]) else None


def _warning(warning: ModelWarning, rig: RigUnderTest) -> identifier_pb2.ModelWarning:
    channels = rig.drives if warning.of_drive else rig.responses
    name = "" if warning.channel is None else channels[warning.channel].name
    lowest, highest = warning.band or (0.0, 0.0)
    return identifier_pb2.ModelWarning(
        code=_WARNING_CODES.get(warning.code, identifier_pb2.MODEL_WARNING_CODE_OTHER),
        channel=name,
        lowest_frequency=lowest,
        highest_frequency=highest,
        sentence=with_names(warning.sentence, rig),
    )


def _level_warnings(
    estimate: FrfEstimate, *, rig: RigUnderTest, levels: DistortionLevels | None
) -> list[identifier_pb2.ModelWarning]:
    """Warn if the level ruined the model; an experiment without degrees of freedom does not show it."""
    drives = len(rig.drives)
    held = estimate.valid & (estimate.degrees_of_freedom > 0.0)
    if not held.any():
        return []
    check = check_level(
        lines=held,
        residual_psd=estimate.unexplained_psd,
        response_psd=estimate.response_psd,
        random_share=drives / np.where(held, estimate.averages, 1.0),
        noise_psd=None if levels is None else levels.noise_psd / levels.periods,
    )
    if not check.ruined.any():
        return []
    spacing = estimate.frequency[1] - estimate.frequency[0]
    sentence = level_sentence(
        check,
        drive_rms=np.sqrt(np.sum(estimate.drive_psd[held], axis=0) * spacing),
        room=np.array([0.5 * (channel.maximum - channel.minimum) for channel in rig.drives]),
    )
    return [
        identifier_pb2.ModelWarning(
            code=identifier_pb2.MODEL_WARNING_CODE_LEVEL,
            channel=rig.responses[int(np.argmax(check.miss))].name,
            sentence=with_names(sentence, rig),
        )
    ]


def _distortion(levels: DistortionLevels) -> identifier_pb2.Distortion:
    return identifier_pb2.Distortion(
        noise_psd=to_array(levels.noise_psd),
        distortion_psd=to_array(levels.distortion_psd),
        odd_distortion_psd=None if levels.odd_psd is None else to_array(levels.odd_psd),
        even_distortion_psd=None if levels.even_psd is None else to_array(levels.even_psd),
        distortion_share=to_array(distortion_shares(levels).over_band),
        noise_share=to_array(noise_shares(levels).over_band),
    )
