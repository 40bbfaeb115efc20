"""Campaign control of the SDK: choose a free name, follow to the end, stop, collect, resume."""

from __future__ import annotations

import os
import queue
import re
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Final

from duralab.arguments import whole_number
from duralab.campaign import Campaign, PartialSettings, acceptance_message, completed, stop_message, update_message
from duralab.data import Rig
from duralab.errors import CampaignFaultError, InputError, LabError, ServiceEndedError, ended
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.client import FOREVER, Deadline, LabClient, require_one
from duralab.lab.fetching import Recovery, fetch_result
from duralab.lab.progress import ENDED, POLL_SECONDS, OnProgress, progress_of
from duralab.lab.recordings_folder import RecordingsPlace
from duralab.output_files import OUTPUTS, require_outputs
from duralab.recording import Recording
from duralab_bus import BusError, FaultError, StreamItem
from duralab_proto.decisions import decisions_in_force, revised_specification
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2

SILENCE_SECONDS: Final = 10.0
_STOP_SILENCE_SECONDS: Final = 2.0


def free_id(ask: LabClient, name: str, *, first: int = 1) -> str:
    """Return the campaign's name, with a number if the lab's recorder already has a recording of that name."""
    taken = {
        information.recording
        for information in ask.query(
            ask.bus.keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList
        ).recordings
    }
    numbered = (name if number == 1 else f"{name}-{number}" for number in range(first, first + len(taken) + 1))
    return next(candidate for candidate in numbered if candidate not in taken)


def followed(
    ask: LabClient,
    id: str,
    *,
    begin: Callable[[], iterator_pb2.CampaignStatus],
    on_progress: OnProgress,
    recovery: Recovery,
    deadline: Deadline = FOREVER,
) -> iterator_pb2.CampaignStatus:
    """Begin a campaign and follow it to its end; after any error, stop it and report where its recording is."""
    begun, played = False, False
    bus, events = ask.bus, queue.SimpleQueue[iterator_pb2.CampaignStatus]()

    def put(item: StreamItem[iterator_pb2.CampaignEvent]) -> None:
        events.put(item.message.status)

    def stopped(reason: str, *, silence_seconds: float = SILENCE_SECONDS) -> None:
        # Best effort: the remaining services end with the lab.
        with suppress(FaultError, BusError):
            stop_campaign(ask, id, reason=reason, silence_seconds=silence_seconds)

    try:
        try:
            key = bus.keys.campaign_event(id)
            with closing(bus.subscribe(key, iterator_pb2.CampaignEvent, put, repair=True)):
                status, begun = begin(), True
                while True:
                    played = bool(status.iterations)
                    if (failure := ask.failure()) is not None:
                        raise failure
                    on_progress(progress_of(status))
                    if status.phase in ENDED:
                        return status
                    if deadline.is_set():
                        raise deadline.error(f"The campaign {id!r}")
                    try:
                        status = events.get(timeout=POLL_SECONDS)
                    except queue.Empty:
                        key, request = bus.keys.campaign(id), iterator_pb2.CampaignRequest()
                        status = bus.query(key, request, iterator_pb2.CampaignStatus)
        except FaultError as fault:
            error = ask.explained(fault)
            # A refused campaign has no recording.
            raise (recovery.annotate(error, played=played) if begun else error) from fault
        except LabError as error:
            ended_itself = isinstance(error, ServiceEndedError)
            stopped(str(error), silence_seconds=_STOP_SILENCE_SECONDS if ended_itself else SILENCE_SECONDS)
            raise recovery.annotate(error, played=played) from error
    except KeyboardInterrupt as interrupt:
        try:
            # A user who interrupts does not want to wait for a service that has ended.
            stopped("interrupted by the user", silence_seconds=_STOP_SILENCE_SECONDS)
            recovery.annotate(interrupt, played=played)
        except KeyboardInterrupt as again:
            recovery.annotate(again, played=played, fetch=False)
            raise
        raise


def stop_campaign(
    ask: LabClient, id: str, *, reason: str, silence_seconds: float = SILENCE_SECONDS
) -> iterator_pb2.CampaignStatus:
    """Stop a campaign; raises FaultError if the iterator has no such campaign."""
    key = ask.key("id", ask.bus.keys.campaign_stop, id)
    require_one(key)
    return ask.bus.query(
        key,
        iterator_pb2.StopCampaignRequest(reason=reason),
        iterator_pb2.CampaignStatus,
        silence_seconds=silence_seconds,
    )


def collect(
    ask: LabClient,
    specification: iterator_pb2.CampaignSpec,
    status: iterator_pb2.CampaignStatus,
    *,
    folder: Path,
    recovery: Recovery,
) -> CampaignResult:
    """Fetch the result of a campaign; if it ended early, fetch its recording and raise CampaignFaultError."""
    if status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        error = ask.failure() or CampaignFaultError(
            ended(status.fault.message or f"The campaign {status.id!r} ended early: {status.activity}"),
            field=status.fault.field,
            service=status.fault.service,
        )
        raise recovery.annotate(error, played=bool(status.iterations))
    try:
        result = fetch_result(ask.bus, specification, status, folder=folder, place=recovery.place)
    except FaultError as fault:
        raise recovery.annotate(ask.explained(fault), played=True, fetch=False) from fault
    except LabError as error:
        raise recovery.annotate(error, played=True, fetch=False) from error
    except KeyboardInterrupt as interrupt:
        recovery.annotate(interrupt, played=True, fetch=False)
        raise
    recovery.place.fetched.add(specification.id)
    return result


_REFUSED: Final = frozenset(
    {
        query_pb2.FAULT_CODE_INVALID_ARGUMENT,
        query_pb2.FAULT_CODE_FAILED_PRECONDITION,
        query_pb2.FAULT_CODE_NOT_FOUND,
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
        query_pb2.FAULT_CODE_BUSY,
    }
)
"""Fault codes after which no campaign was begun."""


def recording_file(given: str | Path) -> Path | None:
    """Return the path of a recording if a path is given; None for the id of a campaign, which has no dot or slash."""
    if isinstance(given, os.PathLike) or (isinstance(given, str) and (os.sep in given or given.endswith(".mcap"))):
        return Path(given)
    return None


def expected_id(recording: Recording, *, is_changed: bool) -> str:
    """Return the name of the campaign that continues a recording, in a lab without other recordings."""
    id = recording.specification.id
    if recording.closed is None and not is_changed:
        return id
    stem, number = _stem_and_number(id)
    return f"{stem}-{number + 1}"


def specification_of(ask: LabClient, id: str) -> iterator_pb2.CampaignSpec:
    """Return the specification of a campaign, from the first step of its recording."""
    key = ask.key("id", ask.bus.keys.recording_steps, id)
    answer = ask.query(key, recorder_pb2.ReadStepsRequest(), recorder_pb2.RecordedSteps)
    first = answer.steps[0] if answer.steps else recorder_pb2.RecordedStep()
    if first.message_type != iterator_pb2.CampaignSpec.DESCRIPTOR.full_name:
        raise LabError(
            f"The recording {id!r} is not that of a campaign: its first step is a {first.message_type!r}; give the id "
            "of one."
        )
    return iterator_pb2.CampaignSpec.FromString(first.payload)


def _put_settings(request: iterator_pb2.ResumeCampaignRequest, settings: Campaign, *, rig: Rig) -> None:
    """Put the update, the stop criteria and the limits of a campaign file into a request."""
    request.update.CopyFrom(update_message(settings.update, rig=rig))
    request.stop.CopyFrom(stop_message(settings.stop))
    request.accept.CopyFrom(acceptance_message(settings.accept))
    request.scenario = settings.text


def _whole_settings(settings: PartialSettings, parent: iterator_pb2.CampaignSpec, *, rig: Rig) -> Campaign:
    """Complete partial settings with the recorded campaign's values; these must agree with its campaign file."""
    recorded = completed(PartialSettings(settings.name, {}), parent)
    same = update_message(recorded.update, rig=rig) == parent.update and stop_message(recorded.stop) == parent.stop
    if not same:
        raise InputError(
            f"The campaign file in the recording of {parent.id!r} does not give the settings that were recorded, as "
            f"that of an older version; give a whole campaign file instead of {settings.name}.",
            field="settings",
        )
    return completed(settings, parent)


def _stem_and_number(id: str) -> tuple[str, int]:
    """Split a campaign's name into its stem and the number that the lab added: "demo-3" into "demo" and 3."""
    match = re.fullmatch(r"(?P<stem>.+)-(?P<number>\d+)", id)
    return (match["stem"], int(match["number"])) if match is not None else (id, 1)


def resume_campaign(
    ask: LabClient,
    id: str,
    *,
    settings: Campaign | PartialSettings | None,
    from_iteration: int,
    describe: Callable[[str], Rig],
    folder: Callable[[str], Path],
    place: RecordingsPlace,
    replace: bool,
    on_progress: OnProgress,
    deadline: Deadline,
) -> CampaignResult:
    """Resume a campaign and collect its result in its `folder`; see `Lab.resume`."""
    parent = _parent(ask, id, from_iteration=from_iteration)
    request = iterator_pb2.ResumeCampaignRequest(from_iteration=from_iteration)
    if settings is not None:
        rig = describe(parent.rig)
        plan = _whole_settings(settings, parent, rig=rig) if isinstance(settings, PartialSettings) else settings
        _put_settings(request, plan, rig=rig)
        if isinstance(settings, PartialSettings) and parent.HasField("accept"):
            # Use the recorded limits: the campaign file's text may give others today.
            request.accept.CopyFrom(parent.accept)

    def begin() -> iterator_pb2.CampaignStatus:
        was_copy = not request.new_id and place.expect_change(id)
        try:
            return ask.bus.query(ask.bus.keys.campaign_resume(id, parent.rig), request, iterator_pb2.CampaignStatus)
        except FaultError as fault:
            if was_copy and fault.code in _REFUSED:
                place.copies.add(id)
            raise

    def resumed(name: str) -> iterator_pb2.CampaignStatus:
        require_outputs([folder(name) / file for file in OUTPUTS], replace=replace)
        request.new_id = name if name != id else ""
        return followed(ask, name, begin=begin, on_progress=on_progress, recovery=recovery(name), deadline=deadline)

    def recovery(name: str) -> Recovery:
        return Recovery(ask, name, folder(name), place)

    name, status = id, None
    if settings is None and from_iteration == 0:
        try:
            status = resumed(name)
        except LabError as error:
            # A recording that is closed for good can only be resumed as a new campaign.
            if error.field != "new_id":
                raise
    if status is None:
        stem, number = _stem_and_number(id)
        name = free_id(ask, stem, first=number + 1)
        try:
            status = resumed(name)
        except LabError as error:
            if error.field != "stop.iterations":
                raise
            raise _no_playback_left(error, id) from error
    specification = _as_resumed(parent, name, request, own_settings=settings is None)
    return collect(ask, specification, status, folder=folder(name), recovery=recovery(name))


def _parent(ask: LabClient, id: str, *, from_iteration: int) -> iterator_pb2.CampaignSpec:
    """Check the parent recording; return its specification with the changes made at hold points."""
    if not (whole_number(from_iteration) and 0 <= from_iteration < 2**32):
        raise InputError(
            f"from_iteration is {from_iteration!r}; give the number of a playback from 1 to 2^32 - 1, or 0 for the "
            "last there is.",
            field="from_iteration",
        )
    key, playbacks, first, total = ask.key("id", ask.bus.keys.recording_steps, id), 0, 0, 1
    decisions, proposals = list[iterator_pb2.Decision](), list[iterator_pb2.Proposal]()
    specification = specification_of(ask, id)
    while first < total:
        answer = ask.query(key, recorder_pb2.ReadStepsRequest(first=first), recorder_pb2.RecordedSteps)
        for step in answer.steps:
            if step.message_type == iterator_pb2.Decision.DESCRIPTOR.full_name:
                decisions.append(iterator_pb2.Decision.FromString(step.payload))
            if step.message_type == iterator_pb2.Proposal.DESCRIPTOR.full_name:
                proposals.append(iterator_pb2.Proposal.FromString(step.payload))
            playbacks += step.message_type == iterator_pb2.IterationStep.DESCRIPTOR.full_name
        first, total = first + len(answer.steps), answer.total if answer.steps else 0
    kept = from_iteration or playbacks
    # Same rule as in the iterator: a change for the next playback applies if the campaign continues there.
    in_force = decisions_in_force(decisions, proposals)
    changed = (each for each in in_force if each.playback <= kept + (kept == playbacks))
    return revised_specification(specification, *changed)


def _as_resumed(
    parent: iterator_pb2.CampaignSpec, name: str, request: iterator_pb2.ResumeCampaignRequest, *, own_settings: bool
) -> iterator_pb2.CampaignSpec:
    """Return the specification of the resumed campaign: its parent's, with the values that the request replaces."""
    specification = iterator_pb2.CampaignSpec()
    specification.CopyFrom(parent)
    specification.id = name
    if not own_settings:
        specification.update.CopyFrom(request.update)
        specification.stop.CopyFrom(request.stop)
        specification.accept.CopyFrom(request.accept)
        specification.scenario = request.scenario
    return specification


def _no_playback_left(error: LabError, id: str) -> InputError:
    """Return the error with the campaign file's names of the settings."""
    return InputError(
        f"Campaign {id} has made as many playbacks as its `stop.iterations` allows; give a campaign file as settings "
        "that allows more, or an earlier playback to build on.",
        field=error.field,
        service=error.service,
    )
