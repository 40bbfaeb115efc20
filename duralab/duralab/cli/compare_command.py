"""`duralab compare`: recorded campaigns beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from duralab.analysis import compare as put_beside
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.opening import open_hint
from duralab.errors import InputError
from duralab.output_files import require_free, require_other
from duralab.recording import open_recording
from duralab.report import write_comparison, write_pdf


def compare(recordings: Sequence[Path], *, out: Path, pdf: Path | None, replace: bool, as_json: bool) -> None:
    """Compare two recordings or more, on the screen and in one HTML file."""
    if len(recordings) < 2:
        raise InputError(f"{recordings[0]} is the only recording given; give two or more to compare.")
    outputs = [out, *([pdf] if pdf else [])]
    opened = [open_recording(recording) for recording in recordings]
    require_other(outputs, read=[file for recording in opened for file in recording.files])
    require_free(outputs, replace=replace)
    comparison = put_beside(*opened)
    write_comparison(out, comparison)
    if pdf is not None:
        write_pdf(comparison, pdf)
    console = console_beside(as_json)
    console.print(str(comparison), highlight=False, markup=False)
    for what, file in (("Comparison", out), *([("PDF", pdf)] if pdf is not None else [])):
        console.print(f"{what}: {file}   open it with:  {open_hint(file)}", highlight=False, markup=False)
    if as_json:
        write_json({**comparison.to_document(), "comparison": out, "pdf": pdf})
