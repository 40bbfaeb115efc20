"""`duralab init`, `run`, `resume` and `stop`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import (
    CampaignId,
    Connect,
    Json,
    OutFolder,
    RealTime,
    Replace,
    complete_campaign,
    complete_rig,
)


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
            help="The rig that reproduces the target, of the lab or gateway at --connect too.",
            autocompletion=complete_rig,
        ),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option("--target", metavar="SIGNALS", help="A measured file to reproduce instead of its target."),
    ] = None,
    connect: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write a campaign file with a comment above every key, for a shipped rig or for one of a lab that runs."""
    from duralab.cli.init_command import init as write

    write(file, template=template, rig=rig, target=target, endpoint=connect, replace=replace, as_json=as_json)


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
    connect: Annotated[
        str | None,
        typer.Option(
            "--connect", metavar="ENDPOINT", help="Use the lab that listens there; left out: a lab of its own."
        ),
    ] = None,
    real_time: RealTime = False,
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer beside it.")] = False,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Run a campaign to its end, in a lab of its own, or in one that runs already (--connect)."""
    from duralab.cli.run_command import run_campaign

    run_campaign(campaign, out=out, endpoint=connect, real_time=real_time, view=view, replace=replace, as_json=as_json)


def resume(
    campaign: Annotated[
        str,
        typer.Argument(metavar="ID|FILE", help="A campaign of a lab that runs, or a recording.mcap: in a private lab."),
    ],
    *,
    settings: Annotated[
        str | None,
        typer.Option(
            "--settings", metavar="FILE", help="YAML with the keys of `update` and `stop` that change from here."
        ),
    ] = None,
    from_iteration: Annotated[
        int, typer.Option("--from", min=0, metavar="N", help="Build on playback N; 0 is the last there is.")
    ] = 0,
    out: OutFolder = None,
    connect: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Resume a campaign that was broken off or has ended, possibly with other settings."""
    from duralab.cli.resume_command import resume as go_on

    go_on(
        campaign,
        endpoint=connect,
        settings=settings,
        from_iteration=from_iteration,
        out=out,
        replace=replace,
        as_json=as_json,
    )


def stop(
    campaign: CampaignId,
    *,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; kept in the recording.")] = "",
    connect: Connect = None,
    as_json: Json = False,
) -> None:
    """Stop a campaign; its rig ramps down where it plays and is latched whatever it does."""
    from duralab.cli.resume_command import stop as end

    end(campaign, endpoint=connect, reason=reason, as_json=as_json)
