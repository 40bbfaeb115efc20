"""`duralab report` and `duralab compare`: recordings as pages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Json, Pdf, Recording, Replace
from duralab.cli.output import Output, page_lines
from duralab.errors import InputError


def report(
    recording: Recording,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The HTML file; report.html beside it if left out.")
    ] = None,
    pdf: Pdf = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write the report of a recording: one HTML file that opens offline."""
    from duralab.output_files import require_outputs
    from duralab.recording import open_recording
    from duralab.report import write_pdf, write_report

    opened = open_recording(recording)
    path = out or opened.path.with_name("report.html")
    require_outputs([path, *([pdf] if pdf else [])], read=opened.files, replace=replace)
    write_report(opened, path)
    if pdf is not None:
        write_pdf(opened, pdf)
    output = Output(as_json)
    output.say(*page_lines("Report", path, pdf=pdf))
    output.document({"report": path, "recording": opened.path, "bytes": path.stat().st_size, "pdf": pdf})


def compare(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING", help="Two recordings or more.")],
    *,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The HTML file to write.")] = Path(
        "comparison.html"
    ),
    pdf: Pdf = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Compare recorded campaigns: errors, settings that differ, and one HTML file with their curves."""
    from duralab.analysis import compare as put_beside
    from duralab.output_files import require_outputs
    from duralab.recording import open_recording
    from duralab.report import write_comparison, write_pdf

    if len(recordings) < 2:
        raise InputError(f"{recordings[0]} is the only recording given; give two or more to compare.")
    opened = [open_recording(recording) for recording in recordings]
    read = [file for recording in opened for file in recording.files]
    require_outputs([out, *([pdf] if pdf else [])], read=read, replace=replace)
    comparison = put_beside(*opened)
    write_comparison(out, comparison)
    if pdf is not None:
        write_pdf(comparison, pdf)
    output = Output(as_json)
    output.say(str(comparison), *page_lines("Comparison", out, pdf=pdf))
    output.document({**comparison.to_document(), "comparison": out, "pdf": pdf})
