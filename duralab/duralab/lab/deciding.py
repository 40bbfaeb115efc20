"""Decisions at a hold point: the campaign's proposal and the answer to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.campaign import PartialSettings, completed, decision_settings, update_message
from duralab.data import Proposal, Rig, Signals
from duralab.errors import InputError
from duralab.lab.campaign_running import specification_of
from duralab.lab.client import LabClient
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, recorder_pb2
from duralab_settings import Decision, DecisionKind, SettingsError
from duralab_settings.messages import fill_message

_LAST_STEPS: Final = 12


def proposal_of(ask: LabClient, id: str) -> Proposal | None:
    """Return the proposal of a waiting campaign, with its samples; None if it waits for no decision."""
    status = ask.query(
        ask.key("id", ask.bus.keys.campaign, id), iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus
    )
    if not status.HasField("hold"):
        return None
    keys = ask.bus.keys
    # While the campaign waits, its proposal is the last committed step.
    steps = ask.query(keys.recording(id), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo).steps
    request = recorder_pb2.ReadStepsRequest(first=steps - 1)
    for step in ask.query(keys.recording_steps(id), request, recorder_pb2.RecordedSteps).steps:
        if step.message_type == iterator_pb2.Proposal.DESCRIPTOR.full_name:
            found = iterator_pb2.Proposal.FromString(step.payload)
            if found.number == status.hold.number:
                return Proposal.from_message(found)
    return Proposal.from_message(status.hold)


def last_drive_of(ask: LabClient, id: str, playback: int) -> Signals | None:
    """Return the drive of a playback while the campaign is recorded; None for playback 0 or a missing drive."""
    keys, kind = ask.bus.keys, iterator_pb2.IterationStep.DESCRIPTOR.full_name
    total = ask.query(keys.recording(id), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo).steps
    # It is nearly always among the last steps; all steps are read only if a decision went back to an earlier one.
    for begin in (max(0, total - _LAST_STEPS), 0) if playback else ():
        first = begin
        while first < total:
            request = recorder_pb2.ReadStepsRequest(first=first, with_samples=True)
            steps = ask.query(keys.recording_steps(id), request, recorder_pb2.RecordedSteps).steps
            for step in steps:
                if step.message_type != kind:
                    continue
                found = iterator_pb2.IterationStep.FromString(step.payload)
                if found.iteration == playback:
                    return _drive(ask, id, found, step)
            if not steps:
                break
            first = steps[-1].step + 1
    return None


def _drive(
    ask: LabClient, id: str, found: iterator_pb2.IterationStep, step: recorder_pb2.RecordedStep
) -> Signals | None:
    if found.HasField("drive"):
        return Signals.from_message(found.drive, field="drive")
    if not step.HasField("drive"):
        return None
    proposed = proposal_of(ask, id)
    if proposed is None or proposed.drive is None:
        return None
    samples = from_array(step.drive, field="drive", shape=(len(proposed.drive.channels), None), dtype=np.float64)
    return replace(proposed.drive, samples=samples)


def decide(
    ask: LabClient,
    id: str,
    kind: DecisionKind | str,
    *,
    proposal: int,
    name: str,
    reason: str,
    settings: PartialSettings | Mapping[str, Any] | str | Path | None,
    from_iteration: int,
    describe: Callable[[str], Rig],
) -> iterator_pb2.CampaignStatus:
    """Answer a proposal; see `Lab.decide`."""
    rig = specification_of(ask, id).rig
    if (kind == DecisionKind.CHANGE) != (settings is not None):
        given = "no settings" if settings is None else "settings"
        raise InputError(
            f"The decision is {kind!s} with {given}; `change`, and no other decision, has settings.", field="settings"
        )
    message = iterator_pb2.Decision()
    try:
        if settings is not None:
            # Fill in the settings before the decision is checked.
            _put_settings(ask, id, message, decision_settings(settings), describe=describe)
        said = {"proposal": proposal, "name": name, "reason": reason, "from_iteration": from_iteration}
        # The settings are already checked. `PLAY` replaces `CHANGE` here, so that only the other fields are checked.
        checked = Decision(kind=DecisionKind.PLAY if kind == DecisionKind.CHANGE else kind, **said)  # type: ignore[arg-type]
    except SettingsError as error:
        raise InputError(str(error), field=error.field) from error
    message.kind = getattr(iterator_pb2, f"DECISION_KIND_{DecisionKind(kind).name}")
    message.proposal, message.name, message.reason = checked.proposal, checked.name, checked.reason
    message.from_iteration = checked.from_iteration
    return ask.query(ask.bus.keys.campaign_decide(id, rig), message, iterator_pb2.CampaignStatus)


def _put_settings(
    ask: LabClient,
    id: str,
    message: iterator_pb2.Decision,
    settings: PartialSettings,
    *,
    describe: Callable[[str], Rig],
) -> None:
    """Put the present settings, with the changed ones, into a decision."""
    waiting = proposal_of(ask, id)
    if waiting is None:
        raise InputError(f"Campaign {id!r} waits for no decision now; look at its status.", field="proposal")
    specification = specification_of(ask, id)
    specification.scenario = waiting.scenario
    plan = completed(settings, specification)
    if "update" in settings.sections:
        message.update.CopyFrom(update_message(plan.update, rig=describe(specification.rig)))
    if "control_band" in settings.sections:
        fill_message(message.control_band, plan.control_band)
    message.scenario = plan.text
