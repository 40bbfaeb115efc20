"""`duralab report`: the report of a recording as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.opening import page_lines
from duralab.cli.options import Json, Pdf, Recording, Replace
from duralab.cli.output import Output


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
    path = out or recording.with_name("report.html")
    require_outputs([path, *([pdf] if pdf else [])], read=opened.files, replace=replace)
    write_report(opened, path)
    if pdf is not None:
        write_pdf(opened, pdf)
    output = Output(as_json)
    output.say(*page_lines("Report", path, pdf=pdf))
    output.document({"report": path, "recording": recording, "bytes": path.stat().st_size, "pdf": pdf})
