"""Remarks on a playback, as sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from duralab_drive_map.messages import to_message
from duralab_proto.v1 import identifier_pb2, iterator_pb2
from iterator.assessment import Standstill
from iterator.campaign.plan import CampaignPlan
from iterator.limits import DriveProjection
from iterator.playbacks import Iteration
from iterator.updates import predict_convergence

_UNRELATED: Final = 0.1
"""Correlation of a response with its target up to which the response contains nothing of the target. Noise alone has
0 ± 0.04 over 10 s of a band of 35 Hz; a good response has more even at a gain of 0.1, unless its noise is ten times
it."""


def remarks_of(
    iteration: Iteration,
    *,
    plan: CampaignPlan,
    recorded: Sequence[iterator_pb2.IterationStep] = (),
    warnings: Sequence[str] = (),
) -> list[str]:
    """Return the remarks of a playback for a person, one sentence each; `warnings` are those of the rig."""
    if iteration.number < len(recorded):
        return list(recorded[iteration.number - 1].remarks)
    of_it = f"Playback {iteration.number}: "
    remarks = [
        # The prediction of the next playback is made again, because its settings may be different.
        *(remark for step in recorded[iteration.number - 1 :] for remark in step.remarks if remark.startswith(of_it)),
        *(f"{of_it}{sentence}" for sentence in warnings),
        *(f"{of_it}{sentence}" for sentence in projection_remarks(iteration.projection, plan)),
        *(
            f"{of_it}the target of {plan.description.responses[found.response].name} from "
            f"{found.segment.start:.2f} to {found.segment.end:.2f} s is out of the rig's reach, the error there is "
            f"{found.relative_rms_error:.2f} of the target's RMS while a drive is at its limit."
            for found in iteration.unreachable
        ),
        *(
            f"{of_it}{sentence}"
            for sentence in standstills_in_words(
                iteration.stood_still, plan=plan, then=_way_on_without(iteration.number)
            )
        ),
        *(f"{of_it}{sentence}" for sentence in _not_reproduced(iteration, plan)),
        *(f"{of_it}{sentence}" for sentence in _rate_limits(iteration, plan)),
        *_bound_passed(iteration, plan),
        *(
            ()
            if iteration.learned is None
            else map_remarks(to_message(iteration.learned), source=f"playback {iteration.number}")
        ),
        *(_growth(iteration, plan) if iteration.outcome is None else ()),
    ]
    # The standstills of a recorded playback are in its step and are found again.
    return list(dict.fromkeys(remarks))


def map_remarks(drive_map: identifier_pb2.DriveMap, *, source: str = "the identification") -> list[str]:
    """Return remarks on the terms of the drive map from a source, and on the terms that were not chosen."""
    terms = "; ".join(term.sentence for term in drive_map.terms)
    return [*([f"Drive map learned from {source}: {terms}."] if terms else ()), *drive_map.remarks]


def standstills_in_words(found: Sequence[Standstill], *, plan: CampaignPlan, then: str) -> list[str]:
    """Return sentences with the response, time and remedy of each standstill."""
    sentences: list[str] = []
    for standstill in found:
        i, when = standstill.response, standstill.segment
        watched = plan.response_weight[i] == 0.0
        sentences.append(
            f"{'the monitored response ' if watched else ''}{plan.description.responses[i].name} stood still from "
            f"{when.start:.2f} s for {when.end - when.start:.2f} s while its target moved; check the sensor and its "
            f"cable{'' if watched else f', then {then}'}."
        )
    return sentences


def _way_on_without(number: int) -> str:
    return f"resume from playback {number - 1} or start anew" if number > 1 else "start anew"


def _not_reproduced(iteration: Iteration, plan: CampaignPlan) -> list[str]:
    """Return remarks on controlled responses without correlation with their target, e.g. of a sensor that only hums."""
    stood_still = {found.response for found in iteration.stood_still}
    return [
        f"{channel.name} has a correlation of {related:.2f} with its target; check its sensor, its sign and the model "
        "there before the drive grows."
        for i, (channel, related) in enumerate(
            zip(plan.description.responses, iteration.metrics.correlation, strict=True)
        )
        if plan.response_weight[i] > 0.0 and related <= _UNRELATED and i not in stood_still
    ]


def _rate_limits(iteration: Iteration, plan: CampaignPlan) -> list[str]:
    """Return a remark on each rate limit that was found in the playbacks before, unless the rig states them."""
    if iteration.model.stated_rate_limits:
        return []
    return [
        f"{channel.name} moved no faster than about {iteration.level * limit.rate:.3g} {channel.unit}/s in the "
        "playbacks before; look whether its valve is at its stop where the error is large."
        for channel, limit in zip(plan.description.drives, iteration.model.rate_limits, strict=False)
        if limit is not None
    ]


def _bound_passed(iteration: Iteration, plan: CampaignPlan) -> list[str]:
    """Return the remark on the bound that ended the campaign."""
    passed = iteration.passed_bound
    if passed is None:
        return []
    name = plan.description.responses[passed.response].name
    return [
        f"Playback {iteration.number}: {passed.sentence(name)}; no further drive is played. Begin at partial levels, "
        "take a smaller gain, or look at the model there."
    ]


def projection_remarks(projection: DriveProjection | None, plan: CampaignPlan) -> list[str]:
    """Return remarks on the exceeded limits of a drive and on its changes."""
    if projection is None:
        return []
    return [
        *map(str, projection.passings),
        *(
            f"The drive of {channel.name} was changed by {100 * change:.2f} % of its RMS to hold its limits"
            + (f"; {100 * clipped:.2f} % had to be clipped and lies outside the control band." if clipped else ".")
            for channel, change, clipped in zip(
                plan.description.drives, projection.change, projection.clipped, strict=True
            )
            if change
        ),
    ]


def _growth(iteration: Iteration, plan: CampaignPlan) -> list[str]:
    """Return the remark on lines where the error is predicted to grow in the next playback."""
    found = predict_convergence(iteration.model, plan.settings.update, playbacks=iteration.number)
    where = found.diverging()
    if not where.size:
        return []
    return [
        f"Before playback {iteration.number + 1}: by the model and its uncertainty the error may grow at {where.size} "
        f"of {found.frequency.size} lines, from {where[0]:.1f} to {where[-1]:.1f} Hz."
    ]
