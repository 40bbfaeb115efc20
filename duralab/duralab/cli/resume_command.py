"""`duralab resume` and `duralab stop`: campaigns of a lab that runs."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from duralab.campaign_loading import load_campaign
from duralab.cli.run_command import exit_with, print_result
from duralab.cli.run_display import RunDisplay
from duralab.lab_opening import connect


def resume(
    id: str, *, endpoint: str, settings: str | None, from_iteration: int, out: Path | None, replace: bool
) -> None:
    """Go on with a campaign and leave its outputs; raises typer.Exit where the target was not reached."""
    console = Console(soft_wrap=True)
    plan = load_campaign(settings) if settings is not None else None
    with connect(endpoint, out=Path("out")) as lab:
        console.print(f"The lab at {endpoint} is asked to go on with campaign {id}.", highlight=False, markup=False)
        with RunDisplay(console) as display:
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
    exit_with(result)


def stop(id: str, *, endpoint: str, reason: str) -> None:
    """Stop a campaign and say how far it got."""
    with connect(endpoint) as lab:
        progress = lab.stop(id, reason=reason)
    Console(soft_wrap=True).print(f"{id}: {progress.activity}", highlight=False, markup=False)
