"""Static part of a target: reproduced by a control band from 0 Hz if the rig can hold it, or else reported."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_bus import FaultError
from duralab_proto.arrays import from_array
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from duralab_spectra import rms
from iterator.band import TARGET_FADE_SECONDS, ControlBand

# Relative to the RMS of the target in the band; smaller static parts are not reported.
_REPORTED_SHARE: Final = 0.1
# Share of a response's largest step. A response that settles exponentially and changes by so much between the third and
# the last quarter of a hold of 4 s comes to rest at twice the step that is used. Beyond it, a model with the measured
# gain asks for drives of more than twice the size, and playbacks with the whole correction diverge at 0 Hz. A response
# that nothing holds rises evenly and changes by 100 %.
_LARGEST_CHANGE: Final = 0.3
# For a specimen at rest these are 0, for any held drives.
_ZERO_AT_REST: Final = {
    array_pb2.CHANNEL_KIND_ACCELERATION: "is an acceleration, which is 0 at rest",
    array_pb2.CHANNEL_KIND_VELOCITY: "is a velocity, which is 0 at rest",
}


def static_response_of(description: rig_pb2.RigDescription) -> NDArray[np.float64]:
    """Return the responses of a rig at drive 0, shape (n_y,): the reference of a control band from 0 Hz."""
    shape = (len(description.responses),)
    return from_array(description.static_response, field="static_response", shape=shape, dtype=np.float64)


def require_static_hold(
    spec: iterator_pb2.CampaignSpec, *, description: rig_pb2.RigDescription, controlled: NDArray[np.bool_]
) -> None:
    """Refuse a control band from 0 Hz on a rig that cannot hold or measure a static part, or without a static gain.

    `controlled`, shape (n_y,): Whether each response is controlled; monitored responses are not checked.
    Raises `FaultError`: FAILED_PRECONDITION with the field `lowest_frequency`, INVALID_ARGUMENT with the field
    `excitation.static_hold`.
    """
    loose = [channel.name for channel in description.drives if not channel.holds_static]
    if loose:
        raise _not_static(
            f"rig {description.rig!r} does not state that it holds a constant {', '.join(loose)}, as displacement "
            "control does and force control without a reference does not: begin above 0 Hz, or let the rig's "
            "description state holds_static where it is true"
        )
    for channel, counts in zip(description.responses, controlled, strict=True):
        why = "is AC-coupled and measures no constant value" if channel.ac_coupled else _ZERO_AT_REST.get(channel.kind)
        if counts and why is not None:
            raise _not_static(
                f"the response {channel.name} of rig {description.rig!r} {why}: begin above 0 Hz, or watch it only"
            )
    if spec.excitation.static_hold == 0.0:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            "The control band begins at 0 Hz and the excitation has static_hold 0, so that the static gain would not "
            "be measured; hold each drive as long as the rig needs to settle, e.g. 4 s.",
            field="excitation.static_hold",
        )


def require_settled(
    model: identifier_pb2.Model,
    *,
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    controlled: NDArray[np.bool_],
) -> None:
    """Refuse a control band from 0 Hz where a response kept changing while the drives were held.

    `model`: As received, untrusted; one of an older recording does not state the change and is not checked.
    `controlled`, shape (n_y,): As for `require_static_hold`.
    Raises `FaultError`: FAILED_PRECONDITION with the field `lowest_frequency`. `ArrayError`: The array is damaged.
    """
    if not model.HasField("static_change"):
        return
    shape = (len(description.responses),)
    change = from_array(model.static_change, field="static_change", shape=shape, dtype=np.float64)
    moving = [
        f"{channel.name} by {100 * share:.0f} %"
        for channel, share, counts in zip(description.responses, change, controlled, strict=True)
        if counts and share > _LARGEST_CHANGE
    ]
    if moving:
        raise _not_static(
            f"responses of rig {description.rig!r} still changed while each drive was held for "
            f"{spec.excitation.static_hold:g} s: {', '.join(moving)} of the step in the second half, and "
            f"{100 * _LARGEST_CHANGE:.0f} % is allowed, beyond which the gain at rest is more than twice the "
            "measured one or the rig does not hold them: begin above 0 Hz, hold the drives longer "
            "(excitation.static_hold), or watch "
            "these responses only"
        )


def _not_static(why: str) -> FaultError:
    return FaultError(
        query_pb2.FAULT_CODE_FAILED_PRECONDITION,
        f"The control band begins at 0 Hz and {why}.",
        field="lowest_frequency",
    )


def static_remarks(
    target: NDArray[np.float64],
    target_in_band: NDArray[np.float64],
    *,
    band: ControlBand,
    description: rig_pb2.RigDescription,
) -> tuple[str, ...]:
    """Return remarks on the static part of the target that is not reproduced, or for a band from 0 Hz on its ends."""
    dynamic = rms(target_in_band)
    if band.lowest == 0.0:
        ends = band.dynamic_part(target)[:, [0, -1]].T
        fade = f"{TARGET_FADE_SECONDS:g} s"
        parts = (
            (ends[0], f"The target does not begin at the rig's static response; it rises from it within {fade} to"),
            (ends[1], f"The target does not end at the rig's static response; it returns to it within {fade} from"),
        )
    else:
        levels = band.static_levels(target)
        parts = (
            (
                levels.mean(axis=1) - static_response_of(description),
                "The static part of the target is not reproduced, the rig keeps what it carries at rest; it differs by",
            ),
            (
                levels[:, 1] - levels[:, 0],
                "The static part of the target drifts from start to end, which is not reproduced; it drifts by",
            ),
        )
    remarks: list[str] = []
    for values, beginning in parts:
        reported = np.flatnonzero((dynamic > 0.0) & (np.abs(values) > _REPORTED_SHARE * dynamic))
        # Three digits, without an exponent: -3100, not -3.1e+03.
        sizes = (
            f"{float(f'{values[i]:.3g}'):+g} {description.responses[i].unit} in {description.responses[i].name}"
            for i in reported
        )
        if reported.size:
            remarks.append(f"{beginning} {', '.join(sizes)}.")
    return tuple(remarks)
