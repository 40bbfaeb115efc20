"""`duralab run`, `duralab resume`, `duralab stop`: campaigns in a private lab or a running one."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.ending import ExitCode, TerminatedError
from duralab.cli.options import (
    CampaignId,
    Connect,
    Json,
    OutFolder,
    Page,
    Profile,
    RealTime,
    Replace,
    View,
    complete_campaign,
    endpoint_of_lab,
    open_lab,
)
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.processes import Viewer


def run(
    campaign: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN",
            help="A campaign or project file, or a shipped one: front_axle_demo, spindle_coupled_demo, "
            "front_axle_events, or belgian_block, whose road does not ship.",
            autocompletion=complete_campaign,
        ),
    ],
    *,
    out: OutFolder = None,
    endpoint: Annotated[
        str | None,
        typer.Option("--connect", metavar="ENDPOINT", help="Endpoint of the lab to use; a private lab if left out."),
    ] = None,
    real_time: RealTime = False,
    view: View = False,
    page: Page = False,
    profile: Profile = False,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Run a campaign or a project to its end, in a private lab or in a running one (--connect)."""
    from duralab.campaign import is_project, load_campaign, missing_target
    from duralab.cli.commands.view import open_page, open_viewer
    from duralab.lab import DEFAULT_RIGS
    from duralab.output_files import OUTPUTS, require_outputs
    from duralab.processes import require_shipped
    from duralab.profile import PROFILE, profiled
    from duralab_bus import import_base_of_scipy

    output = Output(as_json)
    if profile and endpoint is not None:
        raise InputError("--profile belongs to a private lab; leave out --connect, or --profile.", field="profile")
    if (view or page) and endpoint is not None:
        option = "--view" if view else "--page"
        raise InputError(f"{option} is an option of the lab: start the lab at --connect with `duralab up {option}`.")
    if is_project(campaign):
        alone = {"--view": view, "--page": page, "--profile": profile, "--replace": replace, "--real-time": real_time}
        _run_project(campaign, output, out=out, endpoint=endpoint, alone=alone)
        return
    plan = load_campaign(campaign)
    output.say(*plan.remarks)
    place = "the folder of the campaign file" if Path(campaign).is_file() else "the current folder"
    if absent := missing_target(plan, place=place):
        reason = f"{absent[0].lower()}{absent[1:-1]}"
        raise InputError(f"Campaign {plan.name!r} cannot begin: {reason}; put it there, or correct its path.")
    if real_time:
        plan = plan.model_copy(update={"real_time": True})
    folder = out or Path("out") / plan.name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out is {str(folder)!r}, which is a file; give a folder.")
    outputs = (*OUTPUTS, PROFILE) if profile else OUTPUTS
    require_outputs([folder / name for name in outputs], replace=replace)
    if endpoint is None:
        require_shipped(plan.rigs, usual=DEFAULT_RIGS)
    with ExitStack() as stack:
        traces = (
            stack.enter_context(profiled(folder / PROFILE, show=lambda found: output.say(str(found))))
            if profile
            else None
        )
        viewer = open_viewer(stack, output) if view else None
        address = viewer.address if viewer is not None else None
        lab = stack.enter_context(
            open_lab(
                output,
                endpoint,
                rigs=plan.rigs,
                out=folder,
                viewer=address,
                trace_folder=traces,
                # The target is made as soon as the lab is up; some steps of its editor need scipy.signal.
                needs_later=(
                    "duralab.cli.run_display",
                    *((import_base_of_scipy, "duralab_roads") if plan.target.file is None else ()),
                    *(("scipy.signal",) if plan.target.edit else ()),
                ),
            )
        )
        from duralab.cli.run_display import conclude, follow

        if page:
            open_page(stack, output, lab, folder=folder, viewer=viewer)
        where = f"the lab at {endpoint}" if endpoint is not None else f"a private lab at {lab.endpoints[0]}"
        ends = "" if endpoint is not None else ", which ends with it"
        output.say(f"Campaign {plan.name} on rig {plan.rig}, in {where}{ends}.")
        result, report = follow(
            output,
            lambda on_progress: lab.run(plan, out=folder, on_progress=on_progress),
            iterations=plan.stop.iterations,
            endpoint=endpoint or lab.endpoints[0],
            # The operator page and the viewer use the lab until they are closed.
            on_fetched=(lambda: None) if page or viewer is not None else lab.end_services,
        )
        if (viewer is not None or page) and output.console.is_terminal:
            _leave_open(viewer, output)
    conclude(output, result, report)


def _run_project(
    source: str, output: Output, *, out: Path | None, endpoint: str | None, alone: dict[str, bool]
) -> None:
    """Run a project without repeating the results in its folder. `alone`: Options of a single campaign."""
    from duralab.campaign import load_project
    from duralab.lab import DEFAULT_RIGS, EventResult
    from duralab.processes import require_shipped

    if given := [name for name, asked in alone.items() if asked]:
        raise InputError(
            f"{given[0]} belongs to a single campaign; a project continues with what its folder holds, so leave it "
            "out, or give another folder (--out).",
            field=given[0].lstrip("-"),
        )
    project = load_project(source)
    folder = out or Path("out") / project.name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out is {str(folder)!r}, which is a file; give a folder.")
    if endpoint is None:
        require_shipped(project.rigs, usual=DEFAULT_RIGS)
    with open_lab(output, endpoint, rigs=project.rigs, out=folder) as lab:
        where = f"the lab at {endpoint}" if endpoint is not None else f"a private lab at {lab.endpoints[0]}"
        output.say(f"Project {project.name} of {len(project.events)} events, in {where}.")
        count = 0

        def show(event: EventResult) -> None:
            nonlocal count
            count += 1
            _, _, start, playbacks, _, error, _, verdict = event.row
            said = f"{playbacks} playbacks, worst error {error}: {verdict}" if event.result is not None else verdict
            output.say(f"[{count}/{len(project.events)}] {event.event.name} (starts from {start}): {said}")

        result = lab.run_project(project, out=folder, on_event=show)
    written = (("report", result.report_path), ("order file", result.order_path))
    output.say("", str(result), *(f"{what:<10} {path}" for what, path in written if path is not None))
    output.document(result.document())
    if any(event.result is None for event in result.events):
        raise typer.Exit(int(ExitCode.FAILED))
    if not result.reached:
        raise typer.Exit(int(ExitCode.NOT_REACHED))


def _leave_open(viewer: Viewer | None, output: Output) -> None:
    """Keep the viewer or the operator page open; the run is done, so a Ctrl-C here interrupts nothing."""
    output.say(
        "The operator page stays open until you press Ctrl-C."
        if viewer is None
        else "The viewer stays open until you close it or press Ctrl-C."
    )
    try:
        while not (time.sleep(1.0) if viewer is None else viewer.wait(1.0)):
            pass
    except TerminatedError:
        raise
    except KeyboardInterrupt:
        return


def resume(
    campaign: Annotated[
        str,
        typer.Argument(metavar="ID|FILE", help="A campaign of a running lab, or a recording.mcap (in a private lab)."),
    ],
    *,
    settings: Annotated[
        str | None,
        typer.Option("--settings", metavar="FILE", help="YAML with the keys of `update` and `stop` to change."),
    ] = None,
    from_iteration: Annotated[
        int, typer.Option("--from", min=0, metavar="N", help="Playback to build on; 0 is the last one.")
    ] = 0,
    out: OutFolder = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Resume an interrupted or ended campaign, with other settings if given."""
    from duralab.campaign import Campaign, PartialSettings, completed, load_settings
    from duralab.cli.run_display import conclude, follow
    from duralab.lab import expected_id, recording_file
    from duralab.output_files import OUTPUTS, require_outputs
    from duralab.recording import open_recording

    output = Output(as_json)
    plan = load_settings(settings) if settings is not None else None
    output.say(*(plan.remarks if plan is not None else ()))
    with ExitStack() as stack:
        path = recording_file(campaign)
        if path is None:
            endpoint = endpoint_of_lab(endpoint)
            lab = stack.enter_context(open_lab(output, endpoint, out=Path("out")))
            text = f"The lab at {endpoint} is asked to resume campaign {campaign}."
        else:
            if endpoint is not None:
                raise InputError(
                    f"--connect is {endpoint}, and {path} is resumed in a private lab; leave it out, or give the id of "
                    "a campaign that the lab knows.",
                    field="connect",
                )
            recording = open_recording(path)
            if isinstance(plan, PartialSettings):
                # What the lab would refuse is refused before it starts.
                completed(plan, recording.specification_in_use)
            out = out or Path("out") / expected_id(recording, is_changed=plan is not None or from_iteration > 0)
            require_outputs([out / name for name in OUTPUTS], read=recording.files, replace=replace)
            rig = recording.specification.rig
            lab = stack.enter_context(open_lab(output, None, rigs=[rig], out=out))
            text = f"Campaign of {path} on rig {rig}, in a private lab at {lab.endpoints[0]}, which ends with it."
        output.say(text)
        iterations = plan.stop.iterations if isinstance(plan, Campaign) else None
        result, report = follow(
            output,
            lambda on_progress: lab.resume(
                campaign if path is None else path,
                settings=plan,
                from_iteration=from_iteration,
                out=out,
                replace=replace,
                on_progress=on_progress,
            ),
            iterations=iterations,
            endpoint=endpoint or lab.endpoints[0],
            on_fetched=lab.end_services,
        )
    conclude(output, result, report)


def stop(
    id: CampaignId,
    *,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Reason, kept in the recording.")] = "",
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Stop a campaign; its rig ramps down and is latched."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        progress = lab.stop(id, reason=reason)
    output.say(f"{id}: {progress.activity}")
    output.document(
        {"campaign": id}
        | {name: value for name, value in asdict(progress).items() if name not in ("iterations", "hold", "campaign")}
    )
