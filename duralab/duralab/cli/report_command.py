"""`duralab report`."""

from __future__ import annotations

from pathlib import Path

from duralab.cli.json_output import console_beside, write_json
from duralab.cli.opening import open_hint
from duralab.output_files import require_free, require_other


def write(recording: Path, *, out: Path | None, pdf: Path | None, replace: bool, as_json: bool) -> None:
    """Write the report of a recording, as PDF too where a file for it is given, and say how to open it."""
    from duralab.recording import open_recording
    from duralab.report import write_pdf, write_report

    opened = open_recording(recording)
    path = out or recording.with_name("report.html")
    outputs = [path, *([pdf] if pdf else [])]
    require_other(outputs, read=opened.files)
    require_free(outputs, replace=replace)
    write_report(opened, path)
    written = [("Report", path)]
    if pdf is not None:
        written.append(("PDF", write_pdf(opened, pdf)))
    for what, file in written:
        line = f"{what}: {file}   open it with:  {open_hint(file)}"
        console_beside(as_json).print(line, highlight=False, markup=False)
    if as_json:
        write_json({"report": path, "recording": recording, "bytes": path.stat().st_size, "pdf": pdf})
