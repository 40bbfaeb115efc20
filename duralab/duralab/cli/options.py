"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        help="Endpoint of the lab, e.g. tcp/127.0.0.1:7474; that of the running lab if left out.",
    ),
]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite existing output files.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON document on standard output.")]
OutFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for the outputs; out/<campaign> if left out.")
]
Pdf = Annotated[
    Path | None, typer.Option("--pdf", metavar="FILE", help="Write a PDF as well; needs Chromium or Chrome.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Random seed of the simulated rig.")]
RealTime = Annotated[
    bool, typer.Option("--real-time", help="Play no faster than real time, as a rehearsal of a real rig.")
]
Source = Annotated[Path, typer.Argument(metavar="IN", help="A file of signals.")]
Out = Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")]
Recording = Annotated[Path, typer.Argument(help="A recording.mcap.")]
Unit = Annotated[
    list[str] | None,
    typer.Option(
        "--unit", metavar="UNIT", help="SI; or a unit for all channels of its kind; or CHANNEL=UNIT; repeatable."
    ),
]
FileFormat = Annotated[
    str | None,
    typer.Option("--format", metavar="FORMAT", help="rpc3, mdf4, uff58, tdms, mat, csv, parquet; else by the suffix."),
]
DataType = Annotated[
    str | None,
    typer.Option("--data-type", metavar="TYPE", help="rpc3 only: short_integer (default) or floating_point."),
]


def complete_campaign(incomplete: str) -> list[str]:
    """Return the shipped campaigns with this beginning; the shell completes files itself."""
    from duralab.campaign import shipped_campaigns

    return [name for name in shipped_campaigns() if name.startswith(incomplete)]


def complete_rig(incomplete: str) -> list[str]:
    """Return the shipped rigs with this beginning."""
    from duralab.processes import shipped_rigs

    return [name for name in shipped_rigs() if name.startswith(incomplete)]


RigName = Annotated[
    str, typer.Argument(metavar="RIG", help="Name of the rig, e.g. front_axle.", autocompletion=complete_rig)
]
CampaignId = Annotated[str, typer.Argument(metavar="ID", help="Id of the campaign: the name of its recording.")]
