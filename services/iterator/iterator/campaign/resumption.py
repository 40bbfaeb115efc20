"""Start of a resumed campaign: from its own recording after a crash, or from its parent's with other settings."""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from duralab_bus import FaultError
from duralab_proto.decisions import revised_specification
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2
from duralab_settings import ResolvedUpdate
from iterator.campaign.recorded import RecordedCampaign


@dataclass(frozen=True)
class Resumption:
    """The committed steps that a campaign begins with.

    `steps`: Number of steps in its own recording, which is the number of the next one. `model`: As identified.
    `iterations`: Playbacks that are not made again. `confirmations`: Confirmations that are not made again. `planned`:
    Runs on the rig that its own recording has announced. `played`: Runs whose RunPlayed is stored. `copies`: Steps of
    its parent that its own recording does not hold yet. `proposals`, `decisions`: Proposals and decisions of hold
    points. `targets`: Number of targets in the control band in its own recording.
    """

    steps: int = 0
    model: identifier_pb2.Model | None = None
    iterations: tuple[iterator_pb2.IterationStep, ...] = ()
    confirmations: tuple[iterator_pb2.ConfirmationStep, ...] = ()
    planned: tuple[str, ...] = ()
    played: frozenset[str] = frozenset()
    copies: tuple[Message, ...] = ()
    proposals: tuple[iterator_pb2.Proposal, ...] = ()
    decisions: tuple[iterator_pb2.Decision, ...] = ()
    targets: int = 0


def run_name(stem: str, planned: tuple[str, ...]) -> str:
    """Return the name of a playback on the rig: a rig plays each name once, so a further attempt gets a number."""
    attempts = sum(1 for run in planned if run == stem or run.removeprefix(f"{stem}-").isdecimal())
    return f"{stem}-{attempts + 1}" if attempts else stem


def lacks_copies(recorded: RecordedCampaign) -> bool:
    """Return whether a crash came while a campaign stored the steps copied from its parent.

    `recorded`: As the recorder holds it.
    Returns: False if the campaign has ended: then no copies are needed.
    """
    spec = recorded.spec
    if not spec.parent or recorded.closed or recorded.final is not None:
        return False
    return recorded.model is None or len(recorded.iterations) < spec.parent_iteration


def same_campaign(recorded: RecordedCampaign, parent: RecordedCampaign | None = None) -> Resumption:
    """Return the committed steps of a campaign that was interrupted by a crash.

    `recorded`: Not closed. `parent`: Campaign with the missing copies; given if it `lacks_copies`.
    Returns: All its steps, and the missing copies.
    Raises `FaultError`: FAILED_PRECONDITION if it has ended.
    """
    if recorded.closed:
        how = recorded.final.activity if recorded.final is not None else "closed"
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Campaign {recorded.spec.id!r} has ended ({how}) and its recording is closed; name a new_id to take it "
            "up again.",
            field="new_id",
        )
    if parent is not None and parent.model is not None:
        taken = tuple(parent.iterations[: recorded.spec.parent_iteration])
        held = len(recorded.iterations) + (recorded.model is not None)
        return Resumption(
            steps=recorded.steps, model=parent.model, iterations=taken, copies=(parent.model, *taken)[held:]
        )
    return Resumption(
        steps=recorded.steps,
        model=recorded.model,
        iterations=tuple(recorded.iterations),
        confirmations=tuple(recorded.confirmations),
        planned=tuple(recorded.planned),
        played=frozenset(recorded.played),
        proposals=tuple(recorded.proposals),
        decisions=tuple(recorded.decisions),
        targets=recorded.targets,
    )


def finished_unseen(
    recorded: RecordedCampaign, shown: iterator_pb2.CampaignStatus | None
) -> iterator_pb2.CampaignStatus | None:
    """Return the end of a campaign that finished while the recorder's answer was lost.

    `recorded`: As the recorder holds it. `shown`: Final status known to this iterator; None if it does not know the
    campaign.
    Returns: None if no correction is needed.
    """
    finished = iterator_pb2.CAMPAIGN_PHASE_FINISHED
    if shown is None or shown.phase == finished or not recorded.closed or recorded.final is None:
        return None
    return recorded.final if recorded.final.phase == finished else None


def new_campaign(
    recorded: RecordedCampaign, request: iterator_pb2.ResumeCampaignRequest
) -> tuple[iterator_pb2.CampaignSpec, Resumption]:
    """Return a new campaign that resumes another one, and its first steps.

    `recorded`: The parent. `request`: Untrusted request with `new_id`.
    Returns: The parent's specification with other settings, and its model and first playbacks.
    Raises `FaultError`: INVALID_ARGUMENT with the field, or FAILED_PRECONDITION if there is nothing to resume.
    """
    parent, there = recorded.spec.id, len(recorded.iterations)
    if recorded.model is None:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Campaign {parent!r} ended before its rig was identified; there is nothing to resume, start a new one.",
            field="new_id",
        )
    if request.from_iteration > there:
        raise _invalid(
            f"from_iteration is {request.from_iteration}; campaign {parent!r} has {there} playbacks.", "from_iteration"
        )
    kept = request.from_iteration or there
    if any(decision.HasField("control_band") for decision in recorded.decisions):
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Campaign {parent!r} changed its control band at a hold point, so its playbacks are not judged by one "
            "rule; start a new campaign.",
            field="new_id",
        )
    # Changes for the playback after the last one apply to a campaign that continues there.
    changed_for = kept + (kept == there)
    spec = revised_specification(recorded.spec, *(each for each in recorded.decisions if each.playback <= changed_for))
    spec.id, spec.parent, spec.parent_iteration = request.new_id, parent, kept
    if request.HasField("update"):
        spec.update.CopyFrom(request.update)
    if request.HasField("stop"):
        spec.stop.CopyFrom(request.stop)
    if request.HasField("accept"):
        spec.accept.CopyFrom(request.accept)
    if recorded.model.drive_map.terms and spec.update.HasField("drive_map") and not spec.update.drive_map.learn:
        raise _invalid(
            f"update.drive_map.learn is false and the model of campaign {parent!r} goes with its drive map; leave the "
            "key out, or start a new campaign.",
            "update.drive_map.learn",
        )
    spec.scenario = request.scenario or spec.scenario
    # If all playbacks are made, the campaign only confirms the result, or completes an interrupted end.
    finished = recorded.final is not None and recorded.final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    if kept + (finished and spec.confirmations == 0) > spec.stop.iterations:
        raise _invalid(
            f"stop.iterations is {spec.stop.iterations} and counts the {kept} playbacks that are taken "
            f"over from {parent!r}; give more, or an earlier from_iteration.",
            "stop.iterations",
        )
    taken = tuple(recorded.iterations[:kept])
    return spec, Resumption(model=recorded.model, iterations=taken, copies=(recorded.model, *taken))


def require_same_drive_map(before: ResolvedUpdate, after: ResolvedUpdate) -> None:
    """Refuse a change between use and no use of a drive map within a campaign."""
    if before.drive_map.learn != after.drive_map.learn:
        raise _invalid(
            f"update.drive_map.learn is {after.drive_map.learn} and was {before.drive_map.learn}; it stays as it is "
            "within a campaign: start a new one.".replace("True", "true").replace("False", "false"),
            "update.drive_map.learn",
        )


def require_no_settings(request: iterator_pb2.ResumeCampaignRequest) -> None:
    """Refuse other settings for a campaign that continues in its own recording.

    `request`: Without `new_id`.
    Raises `FaultError`: INVALID_ARGUMENT naming the setting.
    """
    given = [
        name
        for name, there in (
            ("from_iteration", request.from_iteration > 0),
            ("update", request.HasField("update")),
            ("stop", request.HasField("stop")),
            ("accept", request.HasField("accept")),
            ("scenario", bool(request.scenario)),
        )
        if there
    ]
    if given:
        raise _invalid(
            f"{given[0]} is given without a new_id; a campaign continues as specified, other settings make a new "
            "one: name it.",
            "new_id",
        )


def _invalid(message: str, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)
