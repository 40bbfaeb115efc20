"""Projects: campaigns of many events; each starts from the most similar ones' results, and can be resumed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from duralab.campaign import Campaign, Event, Project, StartFrom
from duralab.errors import InputError, LabError, ServiceEndedError, StoppedError
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.campaign_running import resume_campaign, specification_of
from duralab.lab.campaign_starting import MadeTarget, StartingLab, made_target, run_one
from duralab.lab.client import Deadline
from duralab.lab.event_order import RESEMBLES, Likeness, likeness, nearest, ordered
from duralab.lab.fetching import fetch_files
from duralab.lab.known_before import holds_model
from duralab.lab.progress import OnProgress, RunProgress
from duralab.lab.project_drives import write_drives
from duralab.lab.project_result import EventResult, ProjectResult
from duralab.lab.recordings_folder import RECORDINGS
from duralab.output_files import OUTPUTS
from duralab.recording import open_recording
from duralab_bus import FaultError
from duralab_proto.arrays import from_record
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from duralab_recordings import is_begun

_LEARN_FROM: Final = 3
"""Number of events whose playbacks another event learns from; further ones add little and cost the same each."""

OnEvent = Callable[[EventResult], None]


@dataclass(frozen=True)
class _Run:
    """Parameters of running the events of a project."""

    lab: StartingLab
    project: Project
    folder: Path
    on_progress: OnProgress
    deadline: Deadline
    on_event: OnEvent

    def folder_of(self, event: Event) -> Path:
        return self.folder / event.name


def run_project(
    lab: StartingLab,
    project: Project,
    *,
    folder: Path,
    on_progress: OnProgress,
    deadline: Deadline,
    on_event: OnEvent,
) -> ProjectResult:
    """Run every event of a project without a result in `folder`; see `Lab.run_project`."""
    lock, halt = threading.Lock(), deadline.cancel or threading.Event()

    def report_in_turn(progress: RunProgress) -> None:
        with lock:
            on_progress(progress)

    def on_event_in_turn(result: EventResult) -> None:
        with lock:
            on_event(result)

    run = _Run(lab, project, folder, report_in_turn, replace(deadline, cancel=halt), on_event_in_turn)
    # Results with other settings are refused before anything moves.
    for event in project.events:
        _finished(run, event)
    targets = {event.name: _target(run, event) for event in project.events}
    for event in project.events:
        _require_same_target(run, event, targets[event.name])
    rigs = list(dict.fromkeys(event.campaign.rig for event in project.events))
    with ThreadPoolExecutor(len(rigs), thread_name_prefix="rig") as threads:
        running = [threads.submit(_run_rig, run, rig, targets) for rig in rigs]
        try:
            wait(running)
        except BaseException:
            # The campaigns of all rigs end before the interrupt is raised again.
            halt.set()
            raise
    results = tuple(result for one in running for result in one.result())
    return _concluded(run, results)


def _run_rig(run: _Run, rig: str, targets: dict[str, MadeTarget]) -> list[EventResult]:
    """Run the events of one rig, one after the other."""
    events = [event for event in run.project.events if event.campaign.rig == rig]
    alike = _likeness(events, targets)
    done: dict[int, CampaignResult] = {}
    results: list[EventResult] = []
    # One identification of each rig: the model of the first event that has one, whether or not it reached its target.
    model, identified = None, ""
    for number in ordered(alike.distance, [event.settings.priority for event in events]):
        event, near = events[number], nearest(alike.distance, number, list(done), most=_LEARN_FROM)
        target = targets[event.name]
        plan = _from_nearest(
            event.campaign,
            [done[each] for each in near],
            model=model,
            explained=float(alike.explained[near[-1], number]) if near else 0.0,
            target=target,
        )
        result = _of_event(run, event, plan, target, started_from=events[near[-1]].name if near else identified)
        results.append(result)
        if model is None:
            model = _recorded_model(run, result)
            identified = event.name if model is not None else ""
        # An event that missed its target has data of the rig away from the wanted responses, so it is no start.
        if result.result is not None and result.reached:
            done[number] = result.result
        run.on_event(result)
    return results


def _of_event(run: _Run, event: Event, plan: Campaign, target: MadeTarget, *, started_from: str) -> EventResult:
    """Run, resume or read an event and return its result; raise errors that end the whole lab."""
    folder = run.folder_of(event)
    try:
        result = _finished(run, event) or _resumed(run, event)
        if result is None:
            result = run_one(
                run.lab,
                plan,
                id=plan.name,
                folder=folder,
                on_progress=run.on_progress,
                deadline=run.deadline,
                target=target,
            )
        if not (folder / OUTPUTS[2]).is_file():
            result.report(folder / OUTPUTS[2])
        return EventResult(event, result, started_from)
    except (StoppedError, ServiceEndedError):
        raise
    except LabError as error:
        if run.deadline.is_set() or run.lab.ask.failure() is not None:
            raise
        return EventResult(event, None, started_from, error=str(error))


def _recorded_model(run: _Run, result: EventResult) -> str | None:
    """Return path or id of an event's recording with a model, also if the event ended early; None without a model."""
    done, id = result.result, result.event.campaign.name
    path = done.recording_path if done is not None else run.lab.place.file(id)
    if path is None:
        # The recorder of a lab that this process did not start has it.
        return id if holds_model(id, ask=run.lab.ask) else None
    try:
        return str(path.resolve()) if open_recording(path).model is not None else None
    except InputError:
        # Of an event that ended early perhaps not even the beginning was recorded.
        return None


def _from_nearest(
    plan: Campaign, near: list[CampaignResult], *, model: str | None, explained: float, target: MadeTarget
) -> Campaign:
    """Return an event's campaign that starts from a model and the nearest results, the nearest last.

    It is unchanged without both.
    """
    before = plan.start_from or StartFrom()
    changes: dict[str, object] = {}
    if model is not None and before.model is None:
        changes["model"] = model
    if near:
        changes["learn_from"] = (*before.learn_from, *(each.specification.id for each in near))
        closest = near[-1]
        short = closest.recording.target.samples.shape[1] <= target.edited.signals.samples.shape[1]
        if before.drive is None and before.section is None and short and explained >= RESEMBLES:
            changes["drive"] = str(closest.recording_path.resolve())
    return plan.model_copy(update={"start_from": before.model_copy(update=changes)}) if changes else plan


def _likeness(events: list[Event], targets: dict[str, MadeTarget]) -> Likeness:
    bands = [event.campaign.control_band for event in events]
    signals = [targets[event.name].edited.signals for event in events]
    # If bands differ, compare in their common part, or without a common part in the first event's band.
    lowest, highest = max(band.lowest_frequency for band in bands), min(band.highest_frequency for band in bands)
    if not lowest < highest:
        lowest, highest = bands[0].lowest_frequency, bands[0].highest_frequency
    return likeness([each.samples for each in signals], sample_rate=signals[0].sample_rate, band=(lowest, highest))


def _target(run: _Run, event: Event) -> MadeTarget:
    plan = event.campaign
    rig = run.lab.describe(plan.rig)
    return made_target(run.lab, plan, rig=rig, id=plan.name, on_progress=run.on_progress, deadline=run.deadline)


def _finished(run: _Run, event: Event) -> CampaignResult | None:
    """Return the result of an event that ended before, and copy its recording to the lab's recorder."""
    path = run.folder_of(event) / OUTPUTS[0]
    if not path.is_file():
        return None
    recording = open_recording(path)
    _require_same_settings(recording.specification, event, where=str(path))
    if recording.status is None or recording.status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        return None
    if run.lab.place.folder is not None and run.lab.place.file(recording.specification.id) is None:
        run.lab.place.copy_in(recording)
    return CampaignResult(recording.specification, recording.status, path, path.with_name(OUTPUTS[1]))


def _resumed(run: _Run, event: Event) -> CampaignResult | None:
    """Resume or fetch an event's recording of this recorder, or of a killed one; None if there is no recording."""
    ask, place, id = run.lab.ask, run.lab.place, event.campaign.name
    if place.folder is not None and place.file(id) is None:
        # The command starts its lab in the project's folder, a script perhaps in another one.
        places = {run.folder, place.folder.parent}
        left = [path for folder in places for path in folder.glob(f"{RECORDINGS}*/{id}.mcap")]
        # Nothing in a file that a kill left before its first step was acknowledged: its event is made from the start.
        left = [path for path in left if path.parent != place.folder and is_begun(path)]
        for path in sorted(left, key=lambda path: path.stat().st_mtime)[-1:]:
            place.copy_in(open_recording(path))
    try:
        request = recorder_pb2.RecordingRequest()
        information = ask.bus.query(ask.bus.keys.recording(id), request, recorder_pb2.RecordingInfo)
    except FaultError as fault:
        if fault.code != query_pb2.FAULT_CODE_NOT_FOUND:
            raise ask.explained(fault) from fault
        return None
    _require_same_settings(specification_of(ask, id), event, where=f"the recording {id!r} of the lab")
    if information.ended and information.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        fetch_files(ask.bus, information, folder=run.folder_of(event))
        place.fetched.add(id)
        return _finished(run, event)
    return resume_campaign(
        ask,
        id,
        settings=None,
        from_iteration=0,
        describe=run.lab.describe,
        folder=lambda _name: run.folder_of(event),
        place=place,
        replace=True,
        on_progress=run.on_progress,
        deadline=run.deadline,
    )


def _require_same_settings(specification: iterator_pb2.CampaignSpec, event: Event, *, where: str) -> None:
    if specification.scenario != event.campaign.text:
        raise InputError(
            f"{where} was made with other settings than the project has for event {event.name!r} now; give another "
            "folder (--out), or remove it and the event is made again.",
            field="events",
        )


def _require_same_target(run: _Run, event: Event, target: MadeTarget) -> None:
    path = run.folder_of(event) / OUTPUTS[0]
    if not path.is_file():
        return
    _, _, recorded = from_record(open_recording(path).specification.target, field="target")
    if recorded.tobytes() != target.edited.signals.samples.tobytes():
        raise InputError(
            f"{path} was made for another target than event {event.name!r} has now; give another folder (--out), or "
            "remove it and the event is made again.",
            field="events",
        )


def _concluded(run: _Run, results: tuple[EventResult, ...]) -> ProjectResult:
    """Write the report and the drives of all events that have a result."""
    order_path = write_drives(run.project, results, run.folder / "drives")
    result = ProjectResult(run.project.name, results, order_path=order_path)
    made = [each for each in results if each.result is not None]
    if not made:
        return result
    from duralab.report import EventSection, write_project_report

    header, rows = result.rows()
    report = write_project_report(
        run.folder / "report.html",
        name=run.project.name,
        sentence=result.sentence,
        reached=result.reached,
        header=header,
        rows=rows,
        events=[
            EventSection(each.event.name, each.result.recording, f"{each.event.name}/{OUTPUTS[2]}")
            for each in made
            if each.result is not None
        ],
    )
    return replace(result, report_path=report)
