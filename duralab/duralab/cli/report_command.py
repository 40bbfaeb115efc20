"""`duralab report`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from duralab._outputs import require_free
from duralab.cli.opening import open_hint


def write(recording: Path, *, out: Path | None, replace: bool) -> None:
    """Write the report of a recording and say how to open it."""
    from duralab.recording import open_recording
    from duralab.report import write_report

    path = out or recording.with_name("report.html")
    opened = open_recording(recording)
    require_free([path], replace=replace)
    write_report(opened, path)
    Console(soft_wrap=True).print(f"Report: {path}   open it with:  {open_hint(path)}", highlight=False, markup=False)
