"""Knowledge of a rig before a campaign: checked against that rig, and read from the recorder."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_bus import Bus, FaultError
from duralab_proto.arrays import from_record
from duralab_proto.contents import content_hash
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from iterator.assessment import judge_response
from iterator.campaign.messages import channel_metrics, recorded_playback
from iterator.campaign.plan import CampaignPlan, invalid
from iterator.campaign.recorded import read_campaign
from iterator.model import RigModel
from iterator.playbacks import FirstDrive, KnownBefore, RecordedPlayback
from iterator.updates import controlled_responses

_HOUR_NANOSECONDS: Final = 3600e9
_MODEL: Final = "known.model"


def known_experiment(
    spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription, *, is_new: bool
) -> identifier_pb2.ExperimentPlan:
    """Check the model that a campaign starts from; return the experiment of its identification.

    `spec`: Untrusted specification with a model. `description`: Present description of the rig. `is_new`: Whether the
    campaign starts now; the model's age does not count if it continues.
    Raises `FaultError`: INVALID_ARGUMENT or FAILED_PRECONDITION with the field.
    """
    known, model = spec.known, spec.known.model
    named = f"The model {known.model_source or model.id[:12]!r}"
    if model.id != content_hash(model):
        raise invalid(f"{named} is damaged: its id is not the hash of its content; take another one.", field=_MODEL)
    if model.rig_content_hash != description.content_hash:
        raise _refused(
            f"{named} is of {model.rig or 'another rig'!r} with the content hash {model.rig_content_hash[:12]}, and "
            f"rig {spec.rig!r} has {description.content_hash[:12]}: only a model of this very rig and specimen counts; "
            "identify it again, without start_from.model.",
            field=_MODEL,
        )
    if not 0.0 <= known.largest_model_age < np.inf:
        raise invalid(
            f"known.largest_model_age is {known.largest_model_age:g} hours; it must be finite and 0 or more.",
            field="known.largest_model_age",
        )
    if is_new and known.largest_model_age > 0.0:
        _require_young(known, named)
    if spec.estimator != model.estimator:
        raise invalid(
            f"{named} was estimated with other settings than the campaign states; give the model's.", field="estimator"
        )
    return model.plan


def _require_young(known: iterator_pb2.KnownBefore, named: str) -> None:
    remedy = "identify the rig again, without start_from.model, or allow more in start_from.model_age"
    allowed = f"start_from.model_age allows {known.largest_model_age:g} hours"
    if known.model_time == 0:
        raise _refused(f"{named} does not state when it was identified, and {allowed}; {remedy}.", field=_MODEL)
    age = (time.time_ns() - known.model_time) / _HOUR_NANOSECONDS
    if age > known.largest_model_age:
        raise _refused(f"{named} is {age:.1f} hours old, and {allowed}; {remedy}.", field=_MODEL)


def read_known_before(bus: Bus, plan: CampaignPlan) -> KnownBefore:
    """Return the knowledge for the iteration, read from the recorder.

    `bus`: Bus of the recorder. `plan`: Checked, except for the earlier knowledge.
    Raises `FaultError`: INVALID_ARGUMENT or FAILED_PRECONDITION with the field. `ArrayError`: A record is damaged.
    """
    known = plan.spec.known
    first = _first_drive(known.first_drive, plan) if known.HasField("first_drive") else None
    return KnownBefore(tuple(_playbacks(bus, id, plan) for id in known.learn_from), first)


def first_drive_metrics(
    known: KnownBefore, model: RigModel, *, plan: CampaignPlan
) -> iterator_pb2.IterationMetrics | None:
    """Return the figures of a first drive that has a response to this target, numbered 0; None without one."""
    first = known.first_drive
    if first is None or first.response is None or not first.of_this_target:
        return None
    metrics = judge_response(
        plan.target_in_band,
        plan.settings.update.band.limit_response(first.response),
        controlled=controlled_responses(model),
        measured=first.response,
        target_damage=plan.target_damage,
    )
    return iterator_pb2.IterationMetrics(
        channels=channel_metrics(metrics, plan=plan),
        overall_relative_rms_error=metrics.overall_relative_rms_error,
        level=1.0,
    )


def _playbacks(bus: Bus, id: str, plan: CampaignPlan) -> tuple[RecordedPlayback, ...]:
    try:
        recorded = read_campaign(bus, id)
    except FaultError as fault:
        if fault.code != query_pb2.FAULT_CODE_NOT_FOUND:
            raise
        raise _refused(
            f"start_from.learn_from names {id!r}, of which the recorder holds no recording; leave it out, or bring the "
            "recording back.",
            field="known.learn_from",
        ) from fault
    if not recorded.closed or not recorded.iterations:
        raise _refused(
            f"start_from.learn_from names campaign {id!r}, which has {len(recorded.iterations)} playbacks and has "
            f"{'ended' if recorded.closed else 'not ended'}; name one that ended after a playback.",
            field="known.learn_from",
        )
    described = recorded.description or rig_pb2.RigDescription()
    if described.content_hash != plan.description.content_hash:
        raise _refused(
            f"start_from.learn_from names campaign {id!r} of rig {recorded.spec.rig!r} with the content hash "
            f"{described.content_hash[:12]}, and rig {plan.spec.rig!r} has {plan.description.content_hash[:12]}: "
            "playbacks of another rig or specimen teach nothing; leave it out.",
            field="known.learn_from",
        )
    return tuple(recorded_playback(step, plan=plan, any_length=True) for step in recorded.iterations)


def _first_drive(given: iterator_pb2.FirstDrive, plan: CampaignPlan) -> FirstDrive:
    description = plan.description
    drive = _record(given.drive, description.drives, plan, field="known.first_drive.drive")
    if given.of_this_target and (plan.spec.levels or not given.HasField("response")):
        raise invalid(
            "known.first_drive.of_this_target is set, which needs a response and no levels; give its response, without "
            "levels, or leave it out.",
            field="known.first_drive.of_this_target",
        )
    if not given.HasField("response"):
        return FirstDrive(drive)
    response = _record(given.response, description.responses, plan, field="known.first_drive.response")
    return FirstDrive(drive, response, of_this_target=given.of_this_target)


def _record(
    record: array_pb2.Record, wanted: Iterable[array_pb2.Channel], plan: CampaignPlan, *, field: str
) -> NDArray[np.float64]:
    channels, sample_rate, samples = from_record(record, field=field)
    rate, length = plan.description.sample_rate, plan.target_in_band.shape[1]
    expected = [(channel.name, channel.unit) for channel in wanted]
    if [(channel.name, channel.unit) for channel in channels] != expected or sample_rate != rate:
        raise invalid(
            f"{field} has the channels {', '.join(channel.name for channel in channels)} at {sample_rate:g} Hz; it "
            f"must have {', '.join(name for name, _ in expected)}, in the rig's units, at {rate:g} Hz.",
            field=field,
        )
    if samples.shape[1] != length:
        raise invalid(f"{field} has {samples.shape[1]} samples; the target has {length}: make it as long.", field=field)
    return samples


def _refused(sentence: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, sentence, field=field)
