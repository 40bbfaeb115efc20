"""`duralab rigs`, `play`, `identify`, `check-rig` and `reset`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Connect, Json, RealTime, Replace, RigName, Seed, complete_campaign


def rigs(connect: Connect = None, as_json: Json = False) -> None:
    """List the rigs with their channels, limits and sample rates, and what else is shipped."""
    from duralab.cli.rigs_command import list_rigs

    list_rigs(endpoint=connect, as_json=as_json)


def play(
    rig: RigName,
    drive: Annotated[Path, typer.Argument(metavar="DRIVEFILE", help="The drive: a file of signals of any format.")],
    *,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Where the response goes; <DRIVEFILE>_response.csv if left out."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="UNIT",
            help="Of the drives that name none in DRIVEFILE; or CHANNEL=UNIT, whatever it names; repeatable.",
        ),
    ] = None,
    seed: Seed = 0,
    real_time: RealTime = False,
    connect: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Play a drive file on a rig and write its response; in a lab of its own where none runs."""
    from duralab.cli.play_command import play as go

    go(
        rig,
        drive,
        out=out,
        units=unit or [],
        seed=seed,
        real_time=real_time,
        endpoint=connect,
        replace=replace,
        as_json=as_json,
    )


def identify(
    rig: RigName,
    settings: Annotated[
        str,
        typer.Option(
            "--settings",
            metavar="FILE",
            help="YAML with `excitation` and `estimator`: a campaign, its file, or one of these sections only.",
            autocompletion=complete_campaign,
        ),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the frequency responses, into .uff or .unv.")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Instead of the seed in FILE.")] = None,
    connect: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Identify a rig by an experiment and show how good the model is; in a lab of its own where none runs."""
    from duralab.cli.identify_command import identify as go

    go(rig, settings=settings, out=out, seed=seed, endpoint=connect, replace=replace, as_json=as_json)


def check_rig(rig: RigName, connect: Connect = None, as_json: Json = False) -> None:
    """Check that a rig keeps the contract; it is moved by 5 % of its limits, twice for 2 s, stopped and reset."""
    from duralab.cli.check_rig_command import check

    check(rig, endpoint=connect, as_json=as_json)


def reset(rig: RigName, connect: Connect = None, as_json: Json = False) -> None:
    """Clear the latch of an interlocked rig, after the reason is dealt with."""
    from duralab.cli.reset_command import reset as clear

    clear(rig, endpoint=connect, as_json=as_json)
