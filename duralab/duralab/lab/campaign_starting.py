"""Campaign from its plan to its result: make the target, send the specification, follow and fetch."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from duralab.campaign import Campaign, build_specification, check_against_rig
from duralab.data import Rig, Signals
from duralab.errors import InputError
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.campaign_running import collect, followed, free_id
from duralab.lab.client import Deadline, LabClient
from duralab.lab.fetching import Recovery
from duralab.lab.known_before import after_section, best_playback, fill_known, put_first_drive, section_campaign
from duralab.lab.playing import play_drive
from duralab.lab.progress import OnProgress, RunProgress, Stage
from duralab.lab.recordings_folder import RecordingsPlace
from duralab.target import EditedTarget, describe_target, make_target
from duralab_bus import FaultError, SpanKind, span
from duralab_proto.v1 import iterator_pb2


@dataclass(frozen=True)
class StartingLab:
    """Parts of a lab that a campaign needs: session, rigs and recordings."""

    ask: LabClient
    describe: Callable[[str], Rig]
    place: RecordingsPlace


@dataclass(frozen=True)
class MadeTarget:
    """Target of a campaign, and the drive played on the vehicle for it (None for a target from a file)."""

    edited: EditedTarget
    driven: Signals | None


def run_campaign(
    lab: StartingLab, plan: Campaign, *, folder: Callable[[str], Path], on_progress: OnProgress, deadline: Deadline
) -> CampaignResult:
    """Run a campaign to its end, first on a section of its target if the plan has one; see `Lab.run`.

    `folder`: Returns the results folder of a campaign id.
    """
    id = free_id(lab.ask, plan.name)
    out = folder(id)
    of_section = section_campaign(plan)
    if of_section is None:
        return run_one(lab, plan, id=id, folder=out, on_progress=on_progress, deadline=deadline)
    name = free_id(lab.ask, of_section.name)
    before = run_one(lab, of_section, id=name, folder=out / "section", on_progress=on_progress, deadline=deadline)
    whole = after_section(plan, before)
    return run_one(lab, whole, id=id, folder=out, on_progress=on_progress, deadline=deadline, after=before)


def run_one(
    lab: StartingLab,
    plan: Campaign,
    *,
    id: str,
    folder: Path,
    on_progress: OnProgress,
    deadline: Deadline,
    target: MadeTarget | None = None,
    after: CampaignResult | None = None,
) -> CampaignResult:
    """Run one campaign to its end under a free id; `target` and `after` as for `specified`."""
    specification = specified(lab, plan, id=id, on_progress=on_progress, deadline=deadline, target=target, after=after)

    def begin() -> iterator_pb2.CampaignStatus:
        return begun(lab, specification)

    recovery = Recovery(lab.ask, id, folder, lab.place)
    status = followed(lab.ask, id, begin=begin, on_progress=on_progress, recovery=recovery, deadline=deadline)
    return collect(lab.ask, specification, status, folder=folder, recovery=recovery)


def begin_campaign(lab: StartingLab, plan: Campaign, *, on_progress: OnProgress, deadline: Deadline) -> str:
    """Begin a campaign and return its id; see `Lab.begin`."""
    if plan.start_from is not None and plan.start_from.section is not None:
        raise InputError(
            "start_from.section makes two campaigns, and the second one has to be begun after the first: "
            "run it with `duralab run`, or leave the section out.",
            field="start_from.section",
        )
    id = free_id(lab.ask, plan.name)
    specification = specified(lab, plan, id=id, on_progress=on_progress, deadline=deadline)
    if deadline.is_set():
        raise deadline.error(f"The campaign {id!r}")
    try:
        return begun(lab, specification).id
    except FaultError as fault:
        raise lab.ask.explained(fault) from fault


def begun(lab: StartingLab, specification: iterator_pb2.CampaignSpec) -> iterator_pb2.CampaignStatus:
    """Send a specification to the iterator."""
    key = lab.ask.bus.keys.campaign_start(specification.rig)
    return lab.ask.bus.query(key, specification, iterator_pb2.CampaignStatus)


def specified(
    lab: StartingLab,
    plan: Campaign,
    *,
    id: str,
    on_progress: OnProgress,
    deadline: Deadline,
    target: MadeTarget | None = None,
    after: CampaignResult | None = None,
) -> iterator_pb2.CampaignSpec:
    """Return the specification for the iterator, with the target made.

    `target`: Target made before; made now if not given. `after`: Result of the campaign on the section.
    """
    on_progress(RunProgress(Stage.TARGET, "asking the rigs", 0.0, -1.0))
    rig = lab.describe(plan.rig)
    for sentence in rig.overdue:
        on_progress(RunProgress(Stage.TARGET, sentence, 0.0, -1.0, lasting=True))
    check_against_rig(plan, rig)
    made = target or made_target(lab, plan, rig=rig, id=id, on_progress=on_progress, deadline=deadline)
    on_progress(RunProgress(Stage.TARGET, "target made", 1.0, 0.0))
    specification = build_specification(
        plan, id=id, rig=rig, target=made.edited.signals, source=describe_target(plan.target)
    )
    specification.target_steps.extend(record.to_message() for record in made.edited.records)
    if made.driven is not None:
        # With these values the target can be reproduced, sample by sample.
        specification.target_drive.CopyFrom(made.driven.to_message())
        specification.target_rig, specification.target_seed = plan.target.vehicle or "", plan.seed
    if plan.start_from is not None:
        left_out = fill_known(specification, plan.start_from, ask=lab.ask, rig=rig, place=lab.place, folder=plan.folder)
        if left_out:
            on_progress(RunProgress(Stage.TARGET, f"{plan.start_from.drive}: {left_out}", 0.0, -1.0, lasting=True))
        if after is not None and plan.start_from.section is not None:
            name = after.specification.id
            drive, response = best_playback(after.recording, name=name, field="start_from.section")
            first_second = plan.start_from.section.start
            put_first_drive(specification, drive, response, source=name, first_second=first_second)
    return specification


def made_target(
    lab: StartingLab, plan: Campaign, *, rig: Rig, id: str, on_progress: OnProgress, deadline: Deadline
) -> MadeTarget:
    """Make the target of a campaign; a road is played on the vehicle's rig in a run named after `id`."""
    vehicle = lab.describe(plan.target.vehicle) if plan.target.vehicle is not None else None
    driven: list[Signals] = []

    def report_target(progress: RunProgress) -> None:
        on_progress(replace(progress, stage=Stage.TARGET))

    def drive_road(inputs: Signals) -> Signals:
        driven.append(inputs)
        driver = plan.target.vehicle or ""
        on_progress(RunProgress(Stage.TARGET, f"driving {driver} over the road", 0.0, -1.0))
        played = play_drive(
            lab.ask,
            lab.describe(driver),
            inputs,
            run=f"{id}.target-{uuid.uuid4().hex[:8]}",
            seed=plan.seed,
            real_time=False,
            on_progress=report_target,
            deadline=deadline,
        )
        return played.response

    with span("make the target", SpanKind.MATHEMATICS):
        edited = make_target(plan, rig=rig, vehicle=vehicle, play=drive_road)
    for sentence in (record.left_out for record in edited.records if record.left_out):
        on_progress(RunProgress(Stage.TARGET, sentence, 0.0, -1.0, lasting=True))
    return MadeTarget(edited, driven[0] if driven else None)
