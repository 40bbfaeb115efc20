"""`duralab resume`, of a lab's campaign or of a recording's file, and `duralab stop`."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from duralab.campaign import Campaign, PartialSettings, completed, load_settings
from duralab.cli.campaign_summary import campaign_document, exit_with, print_result
from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.run_display import RunDisplay
from duralab.errors import InputError
from duralab.lab import DEFAULT_RIGS, connect, expected_id, recording_file, start
from duralab.output_files import OUTPUTS, require_free, require_other
from duralab.processes import require_shipped
from duralab.recording import open_recording


def resume(
    campaign: str,
    *,
    endpoint: str | None,
    settings: str | None,
    from_iteration: int,
    out: Path | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Resume a campaign and leave its outputs; raises typer.Exit where the target was not reached."""
    console = console_beside(as_json)
    plan = load_settings(settings) if settings is not None else None
    with ExitStack() as stack:
        path = recording_file(campaign)
        if path is None:
            endpoint = endpoint_of_lab(endpoint)
            lab = stack.enter_context(connect(endpoint, out=Path("out")))
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
                completed(plan, recording.specification)
            out = out or Path("out") / expected_id(recording, is_changed=plan is not None or from_iteration > 0)
            outputs = [out / name for name in OUTPUTS]
            require_other(outputs, read=recording.files)
            require_free(outputs, replace=replace)
            rig = recording.specification.rig
            require_shipped([rig], usual=DEFAULT_RIGS)
            with console.status("Starting a private lab …"):
                lab = stack.enter_context(start(out, rigs=[rig]))
            text = f"Campaign of {path} on rig {rig}, in a private lab at {lab.endpoints[0]}, which ends with it."
        console.print(text, highlight=False, markup=False)
        iterations = plan.stop.iterations if isinstance(plan, Campaign) else None
        with RunDisplay(console, iterations=iterations) as display:
            result = lab.resume(
                campaign if path is None else path,
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
