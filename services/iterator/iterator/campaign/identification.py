"""Requests of a campaign to the identifier, for the check and for the run of its one or two experiments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2
from iterator.campaign import seeds
from iterator.campaign.plan import CampaignPlan


def identification_run(spec: iterator_pb2.CampaignSpec) -> str:
    """Return the run name of the first attempt at the identification.

    `spec`: Specification whose id begins the name.
    Returns: Name of the run.
    """
    return f"{spec.id}.identify"


def run_at_target(spec: iterator_pb2.CampaignSpec) -> str:
    """Return the run name of the first attempt at the experiment at the target."""
    return f"{spec.id}.at_target"


def identification_request(
    spec: iterator_pb2.CampaignSpec,
    *,
    run: str,
    check_only: bool,
    map_weight: NDArray[np.float64] | None = None,
) -> identifier_pb2.IdentifyRequest:
    """Return the request that identifies the rig of a campaign.

    `spec`: Checked; every seed is derived from its seed. `run`: Run name of the playback on the rig. `check_only`: Only
    check whether it could be played. `map_weight`, shape (n_y,): Weight of each response in learning a drive map; if
    not given, no map is learned.
    Returns: The message.
    """
    request = identifier_pb2.IdentifyRequest(
        rig=spec.rig,
        excitation=spec.excitation,
        estimator=spec.estimator,
        run=run,
        rig_seed=seeds.derived_seed(spec.seed, seeds.IDENTIFICATION_PLAYBACK),
        check_only=check_only,
        real_time=spec.real_time,
    )
    if map_weight is not None:
        request.drive_map.response_weight.CopyFrom(to_array(map_weight))
    request.excitation.seed = seeds.derived_seed(spec.seed, seeds.EXCITATION)
    return request


def check_at_target(spec: iterator_pb2.CampaignSpec) -> identifier_pb2.IdentifyRequest:
    """Return the request that checks the length of the experiment at the target; its drives are not known yet.

    `spec`: With `at_target`.
    Returns: The message; nothing moves.
    """
    request = identification_request(spec, run=run_at_target(spec), check_only=True)
    _lengthen(request, spec)
    return request


def request_at_target(plan: CampaignPlan, *, run: str, model: identifier_pb2.Model) -> identifier_pb2.IdentifyRequest:
    """Return the request for the second experiment, whose responses have the spectra of the target.

    `plan`: With `at_target` in its specification. `run`: Run name of the playback on the rig. `model`: Model of the
    first experiment.
    Returns: The message.
    """
    spec, description = plan.spec, plan.description
    request = identification_request(spec, run=run, check_only=False, map_weight=plan.map_weight)
    _lengthen(request, spec)
    request.excitation.seed = seeds.derived_seed(spec.seed, seeds.EXCITATION_AT_TARGET)
    request.rig_seed = seeds.derived_seed(spec.seed, seeds.PLAYBACK_AT_TARGET)
    controlled = np.flatnonzero(plan.response_weight > 0.0)
    channels = [description.responses[i] for i in controlled]
    request.shape.model.CopyFrom(model)
    request.shape.target.CopyFrom(to_record(channels, description.sample_rate, plan.target_in_band[controlled]))
    request.shape.lowest_frequency, request.shape.highest_frequency = spec.lowest_frequency, spec.highest_frequency
    request.shape.level = spec.at_target.level
    return request


def _lengthen(request: identifier_pb2.IdentifyRequest, spec: iterator_pb2.CampaignSpec) -> None:
    request.excitation.duration = spec.at_target.duration
    # As many realisations as fit; the static gain is measured once.
    request.excitation.realisations = 0
    request.excitation.static_hold = 0.0
