"""`duralab stop`: end a campaign before its time."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.options import CampaignId, Connect, Json
from duralab.cli.output import Output


def stop(
    id: CampaignId,
    *,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Reason, kept in the recording.")] = "",
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Stop a campaign; its rig ramps down if it plays, and is latched."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        progress = lab.stop(id, reason=reason)
    output.say(f"{id}: {progress.activity}")
    output.document(
        {"campaign": id} | {name: value for name, value in asdict(progress).items() if name != "iterations"}
    )
