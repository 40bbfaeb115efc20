"""`duralab run`: a campaign from its file to its outputs, with what it does now on the screen."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from duralab.campaign import load_campaign
from duralab.cli.campaign_summary import campaign_document, exit_with, print_result
from duralab.cli.ending import TerminatedError
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.lab_commands import open_viewer
from duralab.cli.run_display import RunDisplay
from duralab.errors import InputError
from duralab.lab import DEFAULT_RIGS, connect, start
from duralab.output_files import OUTPUTS, require_free
from duralab.processes import Viewer, require_shipped


def run_campaign(
    campaign: str,
    *,
    out: Path | None,
    endpoint: str | None,
    real_time: bool,
    view: bool,
    replace: bool,
    as_json: bool,
) -> None:
    """Run a campaign and leave its outputs; raises typer.Exit where the target was not reached."""
    console = console_beside(as_json)
    if view and endpoint is not None:
        raise InputError("--view belongs to the lab: start the lab at --connect with `duralab up --view`.")
    plan = load_campaign(campaign)
    if real_time:
        plan = plan.model_copy(update={"real_time": True})
    folder = out or Path("out") / plan.name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out is {str(folder)!r}, which is a file; give a folder.")
    require_free([folder / name for name in OUTPUTS], replace=replace)
    if endpoint is None:
        require_shipped(plan.rigs, usual=DEFAULT_RIGS)
    with ExitStack() as stack:
        viewer = open_viewer(stack, console) if view else None
        address = viewer.address if viewer is not None else None
        with console.status("Joining the lab …" if endpoint is not None else "Starting a lab of its own …"):
            lab = stack.enter_context(
                connect(endpoint, out=folder) if endpoint is not None else start(folder, rigs=plan.rigs, viewer=address)
            )
        where = f"the lab at {endpoint}" if endpoint is not None else f"a lab of its own at {lab.endpoints[0]}"
        ends = "" if endpoint is not None else ", which ends with it"
        console.print(f"Campaign {plan.name} on rig {plan.rig}, in {where}{ends}.", highlight=False, markup=False)
        with RunDisplay(console, iterations=plan.stop.iterations) as display:
            result = lab.run(plan, out=folder, on_progress=display.show)
            display.write_report()
            report = result.report(folder / "report.html")
        print_result(console, result, report)
        if viewer is not None and console.is_terminal:
            _leave_open(viewer, console)
    if as_json:
        write_json(campaign_document(result, report))
    exit_with(result)


def _leave_open(viewer: Viewer, console: Console) -> None:
    """Leave the viewer to whoever looks at it; the run is done, so a Ctrl-C here interrupts nothing."""
    console.print("The viewer stays open until you close it or press Ctrl-C.")
    try:
        while not viewer.wait(1.0):
            pass
    except TerminatedError:
        raise
    except KeyboardInterrupt:
        return
