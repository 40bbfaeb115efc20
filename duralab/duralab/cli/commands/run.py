"""`duralab run`: a campaign from its file to its outputs, with what it does now on the screen."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.choosing_lab import open_lab
from duralab.cli.ending import TerminatedError
from duralab.cli.options import Json, OutFolder, RealTime, Replace, complete_campaign
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.processes import Viewer


def run(
    campaign: Annotated[
        str,
        typer.Argument(
            help="A campaign file, or a shipped one: front_axle_demo, spindle_coupled_demo, belgian_block.",
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
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer.")] = False,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Run a campaign to its end, in a private lab or in a running one (--connect)."""
    from duralab.campaign import load_campaign
    from duralab.cli.campaign_summary import conclude, follow
    from duralab.cli.live_viewer import open_viewer
    from duralab.lab import DEFAULT_RIGS
    from duralab.output_files import OUTPUTS, require_outputs
    from duralab.processes import require_shipped

    output = Output(as_json)
    if view and endpoint is not None:
        raise InputError("--view belongs to the lab: start the lab at --connect with `duralab up --view`.")
    plan = load_campaign(campaign)
    output.say(*plan.remarks)
    if real_time:
        plan = plan.model_copy(update={"real_time": True})
    folder = out or Path("out") / plan.name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out is {str(folder)!r}, which is a file; give a folder.")
    require_outputs([folder / name for name in OUTPUTS], replace=replace)
    if endpoint is None:
        require_shipped(plan.rigs, usual=DEFAULT_RIGS)
    with ExitStack() as stack:
        viewer = open_viewer(stack, output) if view else None
        address = viewer.address if viewer is not None else None
        lab = stack.enter_context(open_lab(output, endpoint, rigs=plan.rigs, out=folder, viewer=address))
        where = f"the lab at {endpoint}" if endpoint is not None else f"a private lab at {lab.endpoints[0]}"
        ends = "" if endpoint is not None else ", which ends with it"
        output.say(f"Campaign {plan.name} on rig {plan.rig}, in {where}{ends}.")
        result, report = follow(
            output,
            lambda on_progress: lab.run(plan, out=folder, on_progress=on_progress),
            iterations=plan.stop.iterations,
        )
        if viewer is not None and output.console.is_terminal:
            _leave_open(viewer, output)
    conclude(output, result, report)


def _leave_open(viewer: Viewer, output: Output) -> None:
    """Keep the viewer open; the run is done, so a Ctrl-C here interrupts nothing."""
    output.say("The viewer stays open until you close it or press Ctrl-C.")
    try:
        while not viewer.wait(1.0):
            pass
    except TerminatedError:
        raise
    except KeyboardInterrupt:
        return
