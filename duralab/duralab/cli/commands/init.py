"""`duralab init`: a campaign file to begin with."""

from __future__ import annotations

import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Connect, Json, Replace, complete_campaign, complete_rig, endpoint_if_any, open_lab
from duralab.cli.output import Output, own_command

if TYPE_CHECKING:
    from duralab.data import Rig


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The campaign file to write.")] = Path("campaign.yaml"),
    *,
    template: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="CAMPAIGN",
            help="The shipped campaign to begin with; the one for the rig, else front_axle_demo, if left out.",
            autocompletion=complete_campaign,
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig",
            metavar="RIG",
            help="The rig that reproduces the target; also one of the lab or gateway at --connect.",
            autocompletion=complete_rig,
        ),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            "--target", metavar="SIGNALS", help="A measured file to reproduce instead of the target of CAMPAIGN."
        ),
    ] = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write a campaign file with a comment above every key, for a shipped rig or one of a running lab."""
    from duralab.campaign import (
        AWAITED_TARGET,
        DEFAULT_TEMPLATE,
        campaign_name,
        campaign_text,
        load_campaign,
        measured_target,
        missing_target,
        parse_campaign,
        shipped_text,
        template_for,
    )
    from duralab.formats import read_signals
    from duralab.output_files import replace_when_complete, require_outputs

    output = Output(as_json)
    require_outputs([file], read=[target] if target is not None else [], replace=replace)
    template = template or (template_for(rig) if rig is not None else DEFAULT_TEMPLATE)
    shipped = parse_campaign(shipped_text(template), name=template)
    described, section, missing = None, None, []
    signals = read_signals(target) if target is not None else None
    if rig is not None or target is not None or endpoint is not None:
        described = _describe(output, rig or shipped.rig, endpoint)
        if signals is not None and target is not None:
            section, missing = measured_target(signals, source=target, folder=file.parent, rig=described)
    text = campaign_text(template, path=file, rig=described, target=section)
    with replace_when_complete(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
    awaited = file.with_name(AWAITED_TARGET) if target is None and "\n  file: " in text else None
    # A rig that was asked for by name may exist in the lab that runs only.
    asked_at = endpoint_if_any(endpoint) if rig is not None else endpoint
    place = "" if asked_at is None else f" --connect {shlex.quote(asked_at)}"
    command = f"{own_command()} run {shlex.quote(str(file))}{place}"
    lines = [f"{file}: campaign {campaign_name(file)}; run it:  {command}"]
    if missing:
        lines.append(f"Say under target.channels which channel of {target} is which: {', '.join(missing)}.")
    if awaited is not None and described is not None:
        wanted = ", ".join(channel.name for channel in described.responses)
        lines.append(f"Put its target at {awaited} first: a file of signals with {wanted}.")
    elif absent := missing_target(load_campaign(file), place="the folder of the campaign file"):
        lines.append(f"{absent} Put it there first.")
    output.say(*lines)
    output.document(
        {
            "file": file,
            "campaign": campaign_name(file),
            "rig": described.name if described is not None else shipped.rig,
            "run": command,
            "to_say": missing,
            "target_awaited": awaited,
        }
    )


def _describe(output: Output, rig: str, endpoint: str | None) -> Rig:
    """Return the description of a rig: at an endpoint, in the running lab, or in a private one."""
    if endpoint is None:
        with open_lab(output, endpoint_if_any(None), rigs=(rig,)) as lab:
            return lab.describe(rig)
    from duralab.lab import FIND_SECONDS, Lab, join_bus
    from duralab_bus import FaultError

    # A gateway alone answers as well: neither identifier nor recorder is needed yet.
    with join_bus(endpoint) as bus:
        with suppress(FaultError):
            bus.wait_for_live({("rig_sim", rig)}, FIND_SECONDS)
        return Lab(bus, out=Path()).describe(rig)
