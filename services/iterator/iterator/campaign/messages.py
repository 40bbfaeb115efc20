"""Values of the core as messages of the contract, and back."""

from __future__ import annotations

from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from duralab_bus import FaultError
from duralab_drive_map import DriveMap
from duralab_drive_map.messages import from_message as drive_map_from_message
from duralab_drive_map.messages import to_message as drive_map_message
from duralab_proto.arrays import ArrayError, from_array, from_record, samples_hash, to_array, to_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.assessment import Forecast, IterationMetrics, Outcome
from iterator.campaign.plan import CampaignPlan
from iterator.campaign.remarks import remarks_of
from iterator.campaign.static_part import require_settled
from iterator.limits import require_rest_within_limits
from iterator.model import ModelUncertainty, RigModel, rig_model
from iterator.playbacks import Iteration, MapFromFirstPlayback, RecordedPlayback

OUTCOMES: Final = {
    Outcome.REACHED: iterator_pb2.OUTCOME_REACHED,
    Outcome.ITERATIONS_USED: iterator_pb2.OUTCOME_ITERATIONS_USED,
    Outcome.DIVERGED: iterator_pb2.OUTCOME_DIVERGED,
    Outcome.NO_IMPROVEMENT: iterator_pb2.OUTCOME_NO_IMPROVEMENT,
    Outcome.DAMAGE_BUDGET_USED: iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED,
    Outcome.RESPONSE_STOOD_STILL: iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL,
    Outcome.BOUND_PASSED: iterator_pb2.OUTCOME_BOUND_PASSED,
    Outcome.ENDED_AT_HOLD_POINT: iterator_pb2.OUTCOME_ENDED_AT_HOLD_POINT,
}
"""Outcome of the contract by outcome of the core."""


def channel_metrics(metrics: IterationMetrics, *, plan: CampaignPlan) -> list[iterator_pb2.ChannelMetrics]:
    """Return the figures of one playback by channel."""
    return [
        iterator_pb2.ChannelMetrics(
            channel=channel.name,
            relative_rms_error=float(metrics.relative_rms_error[i]),
            rms_response=float(metrics.rms_response[i]),
            peak_ratio=float(metrics.peak_ratio[i]),
            crest_ratio=float(metrics.crest_ratio[i]),
            damage_ratio=metrics.damage_ratio[i].tolist(),
            specimen_damage=metrics.specimen_damage[i].tolist(),
            identification_damage=(
                () if metrics.identification_damage is None else metrics.identification_damage[i].tolist()
            ),
            watched=bool(plan.response_weight[i] == 0.0),
            target_energy_outside_band=float(plan.target_energy_outside_band[i]),
        )
        for i, channel in enumerate(plan.description.responses)
    ]


def metrics_message(iteration: Iteration, *, plan: CampaignPlan) -> iterator_pb2.IterationMetrics:
    """Return the figures of one playback, with the names of the rig's responses."""
    channels = channel_metrics(iteration.metrics, plan=plan)
    if iteration.forecast is not None:
        of_controlled = [channel for channel in channels if not channel.watched]
        for row, channel in enumerate(of_controlled):
            channel.forecast.CopyFrom(channel_forecast(iteration.forecast, row))
    return iterator_pb2.IterationMetrics(
        iteration=iteration.number,
        channels=channels,
        overall_relative_rms_error=iteration.metrics.overall_relative_rms_error,
        level=iteration.level,
    )


def channel_forecast(forecast: Forecast, row: int) -> iterator_pb2.ChannelForecast:
    """Return the forecast of a controlled response."""
    return iterator_pb2.ChannelForecast(
        relative_rms_error=float(forecast.metrics.relative_rms_error[row]),
        peak_ratio=float(forecast.metrics.peak_ratio[row]),
        damage_ratio=forecast.metrics.damage_ratio[row].tolist(),
        uncertainty=float(forecast.uncertainty[row]),
        missed=float("nan") if forecast.missed is None else float(forecast.missed[row]),
    )


def step_message(iteration: Iteration, played: rig_pb2.PlayResult, *, plan: CampaignPlan) -> iterator_pb2.IterationStep:
    """Return one playback as it is committed: it refers to the samples of its run, which are in its signal blocks."""
    return iterator_pb2.IterationStep(
        iteration=iteration.number,
        run=played.run,
        samples_hash=samples_hash(iteration.drive, iteration.response),
        metrics=metrics_message(iteration, plan=plan),
        actuators=played.actuators,
        inverse_frf=to_array(iteration.model.inverse_frf),
        error_in_band=to_array((plan.target_in_band - iteration.response_in_band).astype(np.float32)),
        level=iteration.level,
        signal_epoch=played.epoch,
        signal_blocks=played.blocks,
        remarks=remarks_of(iteration, plan=plan, warnings=played.warnings),
        with_drive_map=iteration.with_drive_map,
        judged_target=plan.judged_target,
        alignment=played.alignment if played.HasField("alignment") else None,
        learned_drive_map=None if iteration.learned is None else drive_map_message(iteration.learned),
    )


StepT = TypeVar("StepT", bound=iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep)


def with_samples(
    step: StepT, *, description: rig_pb2.RigDescription, drive: NDArray[np.float64], response: NDArray[np.float64]
) -> StepT:
    """Return a step with the samples of its run."""
    whole = type(step).FromString(step.SerializeToString())
    if isinstance(whole, iterator_pb2.IterationStep):
        to_record(description.drives, description.sample_rate, drive, into=whole.drive)
    to_record(description.responses, description.sample_rate, response, into=whole.response)
    return whole


def recorded_playback(
    step: iterator_pb2.IterationStep, *, plan: CampaignPlan, any_length: bool = False
) -> RecordedPlayback:
    """Check a committed playback and convert it for the iteration; `any_length` for one of another target."""
    description, samples = plan.description, plan.target_in_band.shape[1]
    records: list[NDArray[np.float64]] = []
    for field, message, wanted in (
        ("drive", step.drive, description.drives),
        ("response", step.response, description.responses),
    ):
        try:
            channels, sample_rate, record = from_record(message, field=field)
        except ArrayError as error:
            raise _damaged(f"Playback {step.iteration} was recorded damaged: {error}", field=error.field) from error
        names = [channel.name for channel in channels]
        if names != [channel.name for channel in wanted] or sample_rate != description.sample_rate:
            raise _damaged(
                f"The {field} of playback {step.iteration} was recorded with {len(names)} channels at {sample_rate:g} "
                f"Hz, which are not those of rig {description.rig!r}.",
                field=field,
            )
        if record.shape[1] != samples and not any_length:
            raise _damaged(
                f"The {field} of playback {step.iteration} was recorded with {record.shape[1]} samples; the target "
                f"has {samples}.",
                field=field,
            )
        records.append(record)
    return RecordedPlayback(drive=records[0], response=records[1], with_drive_map=step.with_drive_map)


def checked_response(played: rig_pb2.PlayResult, *, run: str, samples: int, plan: CampaignPlan) -> NDArray[np.float64]:
    """Check the response of a rig to a playback."""
    try:
        channels, sample_rate, response = from_record(played.response, field="response")
    except ArrayError as error:
        raise _damaged(f"The rig answered a damaged response: {error}", field=error.field) from error
    wanted = [channel.name for channel in plan.description.responses]
    if played.run != run:
        raise _damaged(f"The rig answered run {played.run!r}; asked was {run!r}.", field="run")
    if [channel.name for channel in channels] != wanted or sample_rate != plan.description.sample_rate:
        raise _damaged(
            f"The rig answered {len(channels)} channels at {sample_rate:g} Hz, not its {len(wanted)} responses at "
            f"{plan.description.sample_rate:g} Hz.",
            field="response",
        )
    if response.shape[1] != samples:
        raise _damaged(
            f"The rig answered {response.shape[1]} samples to a drive of {samples}.", field="response.samples"
        )
    return response


def run_played(
    played: identifier_pb2.Model | iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep, *, rig: str
) -> recorder_pb2.RunPlayed:
    """Return the number of blocks in the run of a result, for the recorder."""
    return recorder_pb2.RunPlayed(run=played.run, rig=rig, epoch=played.signal_epoch, blocks=played.signal_blocks)


def checked_model(model: identifier_pb2.Model, *, plan: CampaignPlan) -> RigModel:
    """Check the identifier's answer and make the model that the iteration starts from.

    `model`: As received, untrusted. `plan`: Plan of the campaign.
    Returns: Model with its inverse.
    Raises `FaultError`: DATA_LOSS if it is not the requested model; FAILED_PRECONDITION if it cannot be inverted.
    """
    description = plan.description
    for field, given, wanted in (
        ("drives", model.drives, description.drives),
        ("responses", model.responses, description.responses),
    ):
        if [channel.name for channel in given] != [channel.name for channel in wanted]:
            raise _damaged(
                f"The model's {field} are not those of rig {description.rig!r}: it has {len(given)} of {len(wanted)}.",
                field=field,
            )
    lines = plan.spec.estimator.block_samples // 2 + 1
    try:
        frequency = from_array(model.frequency, field="frequency", shape=(lines,), dtype=np.float64)
        shape = (lines, len(description.responses), len(description.drives))
        frf = from_array(model.frf, field="frf", shape=shape, dtype=np.complex128, finite=False)
        uncertainty = _uncertainty(model, lines=lines, responses=shape[1], drives=shape[2])
        static_gain = None
        if plan.settings.update.band.lowest == 0.0:
            static_gain = from_array(model.static_gain, field="static_gain", shape=shape[1:], dtype=np.float64)
            controlled = plan.response_weight > 0.0
            require_settled(model, spec=plan.spec, description=description, controlled=controlled)
    except ArrayError as error:
        raise _damaged(f"The identifier answered a damaged model: {error}", field=error.field) from error
    try:
        return rig_model(
            frequency,
            frf,
            identified_band=plan.identified_band,
            response_weight=plan.response_weight,
            uncertainty=uncertainty,
            static_gain=static_gain,
        )
    except ValueError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The identified model is of no use: {error}", field="frf"
        ) from error


def checked_drive_map(
    model: identifier_pb2.Model, start: RigModel, *, plan: CampaignPlan, corrects: bool = False
) -> DriveMap | MapFromFirstPlayback | None:
    """Check the drive map of a model and return the drive map for the iteration.

    `model`: As received, untrusted. `start`: From `checked_model`. `plan`: Plan of the campaign. `corrects`: Whether
    the campaign begins with a drive that was made for its target: it stays near that drive, and keeps its map.
    Returns: The map of the model, to be learned again from the first playback unless it is the identity; if the model
    has none and the settings request one, one that is learned from the first playback.
    Raises `FaultError`: DATA_LOSS if the map is damaged; FAILED_PRECONDITION if rig or model do not allow it.
    """
    limits = plan.limits
    displaced = tuple(drive.kind == array_pb2.CHANNEL_KIND_DISPLACEMENT for drive in plan.description.drives)
    if not model.HasField("drive_map"):
        learn = plan.settings.update.drive_map.learn
        return MapFromFirstPlayback(limits.names, limits.units, may_follow=displaced) if learn else None
    try:
        drive_map = drive_map_from_message(
            model.drive_map, drives=plan.description.drives, sample_rate=plan.description.sample_rate
        )
        drive_map.require_model(start)
        require_rest_within_limits(drive_map, limits)
    except ArrayError as error:
        raise _damaged(f"The model has a damaged drive map: {error}", field=error.field) from error
    except ValueError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The drive map is of no use: {error}", field="drive_map"
        ) from error
    if drive_map.is_identity or corrects:
        return drive_map
    return MapFromFirstPlayback(limits.names, limits.units, may_follow=displaced, start=drive_map)


def _uncertainty(model: identifier_pb2.Model, *, lines: int, responses: int, drives: int) -> ModelUncertainty | None:
    """Return the covariance of the model, or None if its estimator states none; raises ArrayError."""
    if not (model.HasField("residual_psd") and model.HasField("row_covariance")):
        return None
    return ModelUncertainty(
        residual_psd=from_array(
            model.residual_psd, field="residual_psd", shape=(lines, responses), dtype=np.float64, finite=False
        ),
        row_covariance=from_array(
            model.row_covariance,
            field="row_covariance",
            shape=(lines, drives, drives),
            dtype=np.complex128,
            finite=False,
        ),
    )


def _damaged(message: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_DATA_LOSS, message, field=field)
