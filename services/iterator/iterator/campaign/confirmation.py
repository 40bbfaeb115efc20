"""Confirmation of a result: playbacks of the best drive, their number, and their figures as messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_bus import FaultError
from duralab_proto.arrays import ArrayError, from_array, from_record, samples_hash, to_array
from duralab_proto.v1 import iterator_pb2, query_pb2, rig_pb2
from duralab_settings import StopCriteria
from iterator.assessment import (
    IterationMetrics,
    Outcome,
    Standstill,
    judge_repeatability,
    judge_response,
    standstills,
    would_overspend,
)
from iterator.campaign.messages import channel_metrics
from iterator.campaign.plan import CampaignPlan
from iterator.campaign.remarks import standstills_in_words
from iterator.playbacks import Iteration


@dataclass(frozen=True)
class ConfirmationReport:
    """Report after one of the playbacks that confirm the result.

    `repeatability`: Repeatability of all playbacks so far. `metrics`: Figures of the last one, as a message. Both are
    None if there was no further playback. `remarks`: Reason for that, one sentence.
    """

    repeatability: iterator_pb2.Repeatability | None = None
    metrics: iterator_pb2.IterationMetrics | None = None
    remarks: tuple[str, ...] = ()


def confirmed(
    best: Iteration,
    *,
    plan: CampaignPlan,
    outcome: Outcome,
    metrics: Sequence[IterationMetrics],
    recorded: Sequence[iterator_pb2.ConfirmationStep],
    play: Callable[[Iteration, int], iterator_pb2.ConfirmationStep],
) -> Iterator[ConfirmationReport]:
    """Play the best drive again the requested number of times, unless a reason speaks against it."""
    asked, responses, spent = plan.spec.confirmations, [best.response_in_band], tuple(metrics)
    for number in range(1, asked + 1):
        if number <= len(recorded):
            step = recorded[number - 1]
        else:
            against = reason_against(outcome, spent, plan.settings.stop)
            if against is not None:
                yield ConfirmationReport(
                    remarks=(f"The best drive was played {number - 1} of {asked} times again: {against}.",)
                )
                return
            step = play(best, number)
        response = recorded_confirmation(step, plan=plan)
        stood_still = _stood_still(step, plan=plan)
        remarks = tuple(
            f"Confirmation {number} of {asked}: {sentence}"
            for sentence in standstills_in_words(stood_still, plan=plan, then="resume to confirm the result")
        )
        if any(plan.response_weight[found.response] > 0.0 for found in stood_still):
            yield ConfirmationReport(metrics=step.metrics, remarks=remarks)
            return
        responses.append(response)
        measured = from_array(step.response.samples, field="response.samples", dtype=np.float64)
        judged = judge_confirmation(response, measured, plan=plan)
        spent = (*spent, replace(judged, identification_damage=spent[-1].identification_damage))
        yield ConfirmationReport(
            repeatability_message(responses, iteration=best.number, plan=plan), step.metrics, remarks
        )


def _stood_still(step: iterator_pb2.ConfirmationStep, *, plan: CampaignPlan) -> tuple[Standstill, ...]:
    try:
        _, _, measured = from_record(step.response, field="response")
        return standstills(measured, plan.target_in_band, band=plan.settings.update.band)
    except ValueError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Confirmation {step.number} was recorded damaged: {error}",
            field="response",
        ) from error


def reason_against(outcome: Outcome, spent: tuple[IterationMetrics, ...], criteria: StopCriteria) -> str | None:
    """Return why the best drive is not played again, as text; None if there is no reason."""
    if outcome is Outcome.DIVERGED:
        return "the iteration diverged"
    if outcome is Outcome.RESPONSE_STOOD_STILL:
        return "a controlled response stood still"
    if outcome is Outcome.BOUND_PASSED:
        return "a playback passed a bound"
    if outcome is Outcome.ENDED_AT_HOLD_POINT:
        return "a person ended the campaign at a hold point"
    if outcome is Outcome.DAMAGE_BUDGET_USED or (criteria.damage_budget > 0.0 and would_overspend(spent, criteria)):
        return "one more playback would pass the damage budget"
    return None


def judge_confirmation(
    response_in_band: NDArray[np.float64], measured: NDArray[np.float64], *, plan: CampaignPlan
) -> IterationMetrics:
    """Return the figures of a playback that confirms the result."""
    return judge_response(
        plan.target_in_band,
        response_in_band,
        controlled=plan.response_weight > 0.0,
        measured=measured,
        target_damage=plan.target_damage,
    )


def confirmation_message(
    drive: NDArray[np.float64],
    response: NDArray[np.float64],
    response_in_band: NDArray[np.float64],
    *,
    played: rig_pb2.PlayResult,
    number: int,
    iteration: int,
    plan: CampaignPlan,
) -> iterator_pb2.ConfirmationStep:
    """Return a playback of the best drive as it is committed: it refers to the samples of its run."""
    metrics = judge_confirmation(response_in_band, response, plan=plan)
    return iterator_pb2.ConfirmationStep(
        number=number,
        run=played.run,
        iteration=iteration,
        samples_hash=samples_hash(drive, response),
        error_in_band=to_array((plan.target_in_band - response_in_band).astype(np.float32)),
        metrics=iterator_pb2.IterationMetrics(
            iteration=iteration,
            channels=channel_metrics(metrics, plan=plan),
            overall_relative_rms_error=metrics.overall_relative_rms_error,
            level=1.0,
        ),
        actuators=played.actuators,
        signal_epoch=played.epoch,
        signal_blocks=played.blocks,
        judged_target=plan.judged_target,
        alignment=played.alignment if played.HasField("alignment") else None,
    )


def recorded_confirmation(step: iterator_pb2.ConfirmationStep, *, plan: CampaignPlan) -> NDArray[np.float64]:
    """Return the judged response of a committed playback; raises FaultError DATA_LOSS if it is damaged."""
    shape = plan.target_in_band.shape
    try:
        measured = from_array(step.response.samples, field="response.samples", shape=shape, dtype=np.float64)
        return plan.settings.update.band.limit_response(measured)
    except ArrayError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Confirmation {step.number} was recorded damaged: {error}",
            field=error.field,
        ) from error


def repeatability_message(
    responses_in_band: Sequence[NDArray[np.float64]], *, iteration: int, plan: CampaignPlan
) -> iterator_pb2.Repeatability:
    """Return the repeatability of the rig."""
    found = judge_repeatability(plan.target_in_band, responses_in_band)
    return iterator_pb2.Repeatability(
        iteration=iteration,
        playbacks=found.playbacks,
        channels=[
            iterator_pb2.ChannelRepeatability(
                channel=channel.name,
                noise_floor=float(found.noise_floor[i]),
                relative_rms_error=float(found.relative_rms_error[i]),
                systematic_error=float(found.systematic_error[i]),
            )
            for i, channel in enumerate(plan.description.responses)
        ],
    )
