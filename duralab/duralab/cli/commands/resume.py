"""`duralab resume`: continue a lab's campaign, or that of a recording's file."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.choosing_lab import endpoint_of_lab, open_lab
from duralab.cli.options import Connect, Json, OutFolder, Replace
from duralab.cli.output import Output
from duralab.errors import InputError


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
    from duralab.cli.campaign_summary import conclude, follow
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
                completed(plan, recording.specification)
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
        )
    conclude(output, result, report)
