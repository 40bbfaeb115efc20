"""`duralab report`, `compare`, `export`, `catalogue` and `verify`."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Connect, DataType, FileFormat, Json, Replace, Unit
from duralab.lab import Result

Pdf = Annotated[
    Path | None, typer.Option("--pdf", metavar="FILE", help="Write it as PDF too; needs Chromium or Chrome.")
]


def report(
    recording: Annotated[Path, typer.Argument(help="A recording.mcap.")],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The HTML file; report.html beside it if left out.")
    ] = None,
    pdf: Pdf = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write the report of a recording: one HTML file that opens offline."""
    from duralab.cli.report_command import write

    write(recording, out=out, pdf=pdf, replace=replace, as_json=as_json)


def compare(
    recordings: Annotated[list[Path], typer.Argument(metavar="A B ...", help="Two recordings or more.")],
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="The HTML file that lays them over each other.")
    ] = Path("comparison.html"),
    pdf: Pdf = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Compare recorded campaigns: what each reached, which settings differ; one HTML file with their curves."""
    from duralab.cli.compare_command import compare as go

    go(recordings, out=out, pdf=pdf, replace=replace, as_json=as_json)


def export(
    recording: Annotated[Path, typer.Argument(help="A recording.mcap.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")],
    *,
    what: Annotated[
        str, typer.Option("--what", help="target, drive, response, response_in_band, or frf (into .uff or .unv).")
    ] = "drive",
    playback: Annotated[
        int | None, typer.Option("--playback", metavar="N", help="Which playback; the best if left out.")
    ] = None,
    to_format: FileFormat = None,
    unit: Unit = None,
    data_type: DataType = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write a drive, a response, the target or the frequency responses of a recording into a file."""
    from duralab.cli.convert_command import export as go

    go(
        recording,
        out,
        what=what,
        playback=playback,
        to_format=to_format,
        units=unit or [],
        data_type=data_type,
        replace=replace,
        as_json=as_json,
    )


def catalogue(
    *,
    rig: Annotated[str, typer.Option("--rig", metavar="NAME", help="Only recordings on this rig.")] = "",
    target: Annotated[
        str, typer.Option("--target", metavar="TEXT", help="Only those whose target's source holds this text.")
    ] = "",
    begun_from: Annotated[datetime | None, typer.Option("--from", help="Only those begun then or later.")] = None,
    begun_before: Annotated[datetime | None, typer.Option("--before", help="Only those begun before.")] = None,
    result: Annotated[Result | None, typer.Option("--result", help="Only those that ended so.")] = None,
    connect: Connect = None,
    as_json: Json = False,
) -> None:
    """List the recordings of a lab, all or those that are looked for."""
    from duralab.cli.catalogue_command import list_recordings

    list_recordings(
        endpoint=connect,
        rig=rig,
        target=target,
        begun_from=begun_from,
        begun_before=begun_before,
        result=result,
        as_json=as_json,
    )


def verify(
    recording: Annotated[
        str,
        typer.Argument(metavar="ID|FILE", help="A lab's recording that is closed, or a recording.mcap."),
    ],
    connect: Connect = None,
    as_json: Json = False,
) -> None:
    """Read a recording from end to end: checksums, hashes, steps, signal blocks and the chain of its files."""
    from duralab.cli.catalogue_command import verify as check_recording

    check_recording(recording, endpoint=connect, as_json=as_json)
