"""Was the target reached? The one place that answers, for the report, the command line and a lab script alike."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

import numpy as np

from duralab.errors import InputError
from duralab.iteration_table import IterationTable
from duralab.sentences import ended
from duralab_proto.v1 import iterator_pb2

_ENDS: Final = MappingProxyType(
    {
        iterator_pb2.OUTCOME_REACHED: " It ended because what was asked of it was reached.",
        iterator_pb2.OUTCOME_ITERATIONS_USED: " It ended because all playbacks were used.",
        iterator_pb2.OUTCOME_NO_IMPROVEMENT: " It ended because the last playbacks did not improve the best error.",
        iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED: " It ended because the specimen's damage budget was used.",
    }
)

_WENT_ON: Final = " It went on to the last playback planned."
"""In place of "all playbacks were used", which sounds like a failure beside a target that was reached."""


class Judgement(StrEnum):
    """How a campaign ended, seen from what was wanted."""

    REACHED = "reached"
    NOT_REACHED = "not reached"
    DIVERGED = "diverged"
    NOT_JUDGED = "finished"
    ENDED_EARLY = "ended early"


@dataclass(frozen=True)
class Verdict:
    """The answer and its reason.

    Parameters
    ----------
    judgement : Judgement
        The answer.
    sentence : str
        What a reader needs to know first, with the numbers.
    limit : float or None
        Largest relative RMS error that is accepted; None where nothing was asked.
    """

    judgement: Judgement
    sentence: str
    limit: float | None


def accepted_error(specification: iterator_pb2.CampaignSpec) -> float | None:
    """Return the largest relative RMS error that a campaign accepts, or None where it names none.

    The section `accept` of its campaign file counts; where there is none, the error at which it was to stop.
    """
    from duralab.campaign_loading import parse_campaign

    if specification.scenario:
        try:
            campaign = parse_campaign(specification.scenario, name=specification.id)
        except InputError:
            # Written by another program or version: its words are kept, but they are no campaign file of ours.
            campaign = None
        if campaign is not None and campaign.accept is not None:
            return campaign.accept.relative_rms_error
    return specification.stop.relative_rms_error or None


def judge(
    table: IterationTable, *, limit: float | None, status: iterator_pb2.CampaignStatus | None, open_end: str = ""
) -> Verdict:
    """Judge a campaign by its last playback.

    Parameters
    ----------
    table : IterationTable
        The figures of its playbacks.
    limit : float or None
        Largest relative RMS error of any channel that is accepted.
    status : CampaignStatus or None
        How it ended; None where it did not.
    open_end : str
        Why its recording may go on elsewhere, in words; empty where it does not.
    """
    if status is None or status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED or not len(table):
        fault = status.fault.message if status is not None and status.HasField("fault") else ""
        reason = fault or open_end or "the recording ends before the campaign does."
        done = f"{len(table)} playback{'' if len(table) == 1 else 's'} done"
        return Verdict(Judgement.ENDED_EARLY, f"The campaign ended early, {done}: {ended(reason)}", limit)
    if status.outcome == iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL:
        # No error is told: that of a dead sensor may be any.
        return Verdict(
            Judgement.ENDED_EARLY,
            f"The campaign ended early: in playback {table.numbers[-1]} a controlled response stood still while its "
            "target moved; its sensor gave nothing, and a remark names it.",
            limit,
        )
    errors = table.judged_error[-1]
    worst = int(np.argmax(errors))
    largest = f"{errors[worst]:.3f} ({_words(table.judged[worst])})"
    after, end = f"after playback {table.numbers[-1]}", _ENDS.get(status.outcome, "")
    if status.outcome == iterator_pb2.OUTCOME_DIVERGED:
        return Verdict(
            Judgement.DIVERGED,
            f"The iteration diverged: {after} the largest relative RMS error is {largest}; playback "
            f"{table.numbers[table.best]} was the best.",
            limit,
        )
    if limit is None:
        sentence = f"{after.capitalize()} the largest relative RMS error is {largest}.{end}"
        return Verdict(Judgement.NOT_JUDGED, sentence, None)
    if errors[worst] <= limit:
        if status.outcome == iterator_pb2.OUTCOME_ITERATIONS_USED:
            end = _WENT_ON
        return Verdict(
            Judgement.REACHED,
            f"The target was reached: {after}, every channel's relative RMS error is at most {limit:g}; "
            f"the largest is {largest}.{end}",
            limit,
        )
    above = [_words(name) for name, error in zip(table.judged, errors, strict=True) if error > limit]
    return Verdict(
        Judgement.NOT_REACHED,
        f"The target was not reached: {after}, {len(above)} of {errors.size} channels are above the accepted relative "
        f"RMS error of {limit:g} ({', '.join(above)}); the largest is {largest}.{end}",
        limit,
    )


def compare_with_first(table: IterationTable) -> str:
    """Return in words how the last playback compares with the first, channel by channel."""
    if len(table) < 2:
        return "There was one playback only, so nothing to compare it with."
    worse = [
        _words(name)
        for name, first, last in zip(table.judged, table.judged_error[0], table.judged_error[-1], strict=True)
        if last >= first
    ]
    if not worse:
        return "Every channel is closer to its target than after the first playback."
    return f"Not closer to the target than after the first playback: {', '.join(worse)}."


def repeatability_in_words(status: iterator_pb2.CampaignStatus) -> str:
    """Return in one sentence how the error compares with what the rig repeats; nothing where no drive was repeated."""
    watched = {channel.channel for channel in status.iterations[-1].channels if channel.watched}
    told = [channel for channel in status.repeatability.channels if channel.channel not in watched]
    if not told:
        return ""
    repeated = f"{status.repeatability.playbacks} playbacks of the drive of playback {status.repeatability.iteration}"
    noisy = [channel for channel in told if channel.noise_floor > 0.0]
    if not noisy:
        return f"The rig repeats {repeated} exactly."
    worst = max(noisy, key=lambda channel: channel.relative_rms_error / channel.noise_floor)
    error, floor = worst.relative_rms_error, worst.noise_floor
    return (
        f"By {repeated}, the target is reproduced to within {error / floor:.1f} × of the repeatability; the largest is "
        f"that of {_words(worst.channel)}, {error:.3f} over a noise floor of {floor:.2g}."
    )


def _words(name: str) -> str:
    return name.replace("_", " ")
