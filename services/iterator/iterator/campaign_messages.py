"""Values of the core as messages of the contract, and back."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import ArrayError, from_array, from_record, to_array, to_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from iterator.campaign_plan import CampaignPlan
from iterator.iteration_loop import Iteration
from iterator.iteration_metrics import IterationMetrics
from iterator.rig_model import RigModel, rig_model
from iterator.stop_criteria import Outcome
from labbus import FaultError

OUTCOMES: Final = {
    Outcome.REACHED: iterator_pb2.OUTCOME_REACHED,
    Outcome.ITERATIONS_USED: iterator_pb2.OUTCOME_ITERATIONS_USED,
    Outcome.DIVERGED: iterator_pb2.OUTCOME_DIVERGED,
}
"""Outcome of the core to that of the contract."""


def metrics_message(iteration: int, metrics: IterationMetrics, *, plan: CampaignPlan) -> iterator_pb2.IterationMetrics:
    """Return the figures of one playback, with the names of the rig's responses.

    Parameters
    ----------
    iteration : int
        From 1.
    metrics : IterationMetrics
        Of that playback.
    plan : CampaignPlan
        Names the channels.

    Returns
    -------
    IterationMetrics
        The message.
    """
    return iterator_pb2.IterationMetrics(
        iteration=iteration,
        channels=[
            iterator_pb2.ChannelMetrics(
                channel=channel.name,
                relative_rms_error=float(metrics.relative_rms_error[i]),
                rms_response=float(metrics.rms_response[i]),
                peak_ratio=float(metrics.peak_ratio[i]),
            )
            for i, channel in enumerate(plan.description.responses)
        ],
        overall_relative_rms_error=metrics.overall_relative_rms_error,
    )


def step_message(iteration: Iteration, played: rig_pb2.PlayResult, *, plan: CampaignPlan) -> iterator_pb2.IterationStep:
    """Return one playback as it is committed.

    Parameters
    ----------
    iteration : Iteration
        What was made of it.
    played : PlayResult
        As the rig answered.
    plan : CampaignPlan
        Of the campaign.

    Returns
    -------
    IterationStep
        The message.
    """
    description = plan.description
    return iterator_pb2.IterationStep(
        iteration=iteration.number,
        run=played.run,
        drive=to_record(description.drives, description.sample_rate, iteration.drive),
        response=to_record(description.responses, description.sample_rate, iteration.response),
        metrics=metrics_message(iteration.number, iteration.metrics, plan=plan),
        actuators=played.actuators,
        inverse_frf=to_array(iteration.model.inverse_frf),
        response_in_band=to_array(iteration.response_in_band),
    )


def checked_response(played: rig_pb2.PlayResult, *, run: str, samples: int, plan: CampaignPlan) -> NDArray[np.float64]:
    """Check what the rig answered to a playback.

    Parameters
    ----------
    played : PlayResult
        As received; nothing in it is trusted.
    run : str
        The playback that was asked for.
    samples : int
        Length of its drive.
    plan : CampaignPlan
        Names the channels.

    Returns
    -------
    ndarray, shape (n_y, samples)
        The response.

    Raises
    ------
    FaultError
        DATA_LOSS: another run, other channels, another rate or length, or values that are not finite.
    """
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


def checked_model(model: identifier_pb2.Model, *, plan: CampaignPlan, response_weight: NDArray[np.float64]) -> RigModel:
    """Check what the identifier answered and make the model that the iteration starts from.

    Parameters
    ----------
    model : Model
        As received; nothing in it is trusted.
    plan : CampaignPlan
        Of the campaign.
    response_weight : ndarray, shape (n_y,)
        See `rig_model`.

    Returns
    -------
    RigModel
        With its inverse.

    Raises
    ------
    FaultError
        DATA_LOSS where it is not the model that was asked for; FAILED_PRECONDITION where it cannot be inverted.
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
    except ArrayError as error:
        raise _damaged(f"The identifier answered a damaged model: {error}", field=error.field) from error
    try:
        return rig_model(frequency, frf, identified_band=plan.identified_band, response_weight=response_weight)
    except ValueError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The identified model is of no use: {error}", field="frf"
        ) from error


def _damaged(message: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_DATA_LOSS, message, field=field)
