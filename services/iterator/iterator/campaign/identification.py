"""Request of a campaign to the identifier, for the check and for the run of the experiment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2
from iterator.campaign import seeds


def identification_run(spec: iterator_pb2.CampaignSpec) -> str:
    """Return the run name of the first attempt at the identification.

    `spec`: Specification whose id begins the name.
    Returns: Name of the run.
    """
    return f"{spec.id}.identify"


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
