"""Messages and sentences of a proposed playback."""

from __future__ import annotations

import numpy as np

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import iterator_pb2
from duralab_settings import StopCriteria
from iterator.assessment import PlaybackBoundError
from iterator.campaign.messages import channel_forecast
from iterator.campaign.plan import CampaignPlan
from iterator.campaign.remarks import projection_remarks
from iterator.holds import ProposedPlayback, drive_use


def proposal_message(
    proposed: ProposedPlayback, *, number: int, reason: str, plan: CampaignPlan
) -> iterator_pb2.Proposal:
    """Return a proposal as it is committed."""
    description = plan.description
    message = iterator_pb2.Proposal(
        number=number,
        playback=proposed.number,
        reason=reason,
        level=proposed.level,
        follows=proposed.follows,
        remarks=projection_remarks(proposed.projection, plan),
        scenario=plan.spec.scenario,
    )
    drive, forecast = proposed.drive, proposed.forecast
    if drive is None or forecast is None:
        message.refusal = _refusal(proposed.refusal, plan)
        return message
    for channel, use in zip(description.drives, drive_use(drive, proposed.last_drive, limits=plan.limits), strict=True):
        message.drives.add(
            channel=channel.name,
            peak=use.peak,
            slew=use.slew,
            range_share=use.range_share,
            slew_share=use.slew_share,
            change=use.change,
        )
    for row, name in enumerate(plan.controlled_names):
        message.responses.add(channel=name, forecast=channel_forecast(forecast, row))
    message.overall_relative_rms_error = forecast.metrics.overall_relative_rms_error
    to_record(description.drives, description.sample_rate, drive, into=message.drive)
    message.predicted_response.CopyFrom(to_array(forecast.response.astype(np.float32)))
    return message


def _refusal(refusal: ValueError | None, plan: CampaignPlan) -> str:
    if isinstance(refusal, PlaybackBoundError):
        return refusal.sentence(plan.description.responses[refusal.passed.response].name)
    return str(refusal)


def without_samples(proposal: iterator_pb2.Proposal) -> iterator_pb2.Proposal:
    """Return a proposal without its samples, for the status."""
    shown = iterator_pb2.Proposal()
    shown.CopyFrom(proposal)
    for field in ("drive", "predicted_response", "scenario"):
        shown.ClearField(field)
    return shown


def proposal_in_words(proposal: iterator_pb2.Proposal, stop: StopCriteria) -> str:
    """Return the state of the campaign that waits for a decision, as text without a full stop."""
    waits = (
        f"waiting for a decision on proposal {proposal.number}, before iteration {proposal.playback} of "
        f"{stop.iterations}"
    )
    if proposal.refusal:
        return f"{waits}: no drive could be made with these settings; {proposal.refusal.rstrip('.')}"
    forecasts = [response.forecast for response in proposal.responses]
    column = (3, 5, 8).index(int(stop.damage_exponent))
    return (
        f"{waits}: predicted error {100 * proposal.overall_relative_rms_error:.1f} %, largest peak "
        f"{max(forecast.peak_ratio for forecast in forecasts):.3g} and damage "
        f"{max(forecast.damage_ratio[column] for forecast in forecasts):.3g} of the target's, drives at up to "
        f"{100 * max(max(drive.range_share, drive.slew_share) for drive in proposal.drives):.0f} % of their limits"
    )
