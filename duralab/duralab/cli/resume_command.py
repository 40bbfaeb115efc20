"""`duralab resume` and `duralab stop`: campaigns of a lab that runs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from duralab.campaign_loading import load_campaign
from duralab.cli.campaign_summary import campaign_document, exit_with, print_result
from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.run_display import RunDisplay
from duralab.lab_opening import connect


def resume(
    id: str,
    *,
    endpoint: str | None,
    settings: str | None,
    from_iteration: int,
    out: Path | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Go on with a campaign and leave its outputs; raises typer.Exit where the target was not reached."""
    console = console_beside(as_json)
    plan = load_campaign(settings) if settings is not None else None
    endpoint = endpoint_of_lab(endpoint)
    with connect(endpoint, out=Path("out")) as lab:
        console.print(f"The lab at {endpoint} is asked to go on with campaign {id}.", highlight=False, markup=False)
        with RunDisplay(console, iterations=plan.stop.iterations if plan is not None else None) as display:
            result = lab.resume(
                id,
                settings=plan,
                from_iteration=from_iteration,
                out=out,
                replace=replace,
                on_progress=display.show,
            )
            display.write_report()
            report = result.report()
        print_result(console, result, report)
    if as_json:
        write_json(campaign_document(result, report))
    exit_with(result)


def stop(id: str, *, endpoint: str | None, reason: str, as_json: bool) -> None:
    """Stop a campaign and say how far it got."""
    with connect(endpoint_of_lab(endpoint)) as lab:
        progress = lab.stop(id, reason=reason)
    console_beside(as_json).print(f"{id}: {progress.activity}", highlight=False, markup=False)
    if as_json:
        told = asdict(progress)
        del told["iterations"]
        write_json({"campaign": id, **told})
