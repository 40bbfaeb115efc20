"""Report as PDF: the HTML page, printed by a headless browser."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from duralab.analysis import Comparison
from duralab.errors import LabError
from duralab.output_files import replace_when_complete, require_other
from duralab.recording import Recording, open_recording
from duralab.report.campaign_report import write_report
from duralab.report.comparison_report import write_comparison

BROWSERS: Final = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
)
"""Names of programs that print a page to a file; the first found is used."""

PATIENCE_SECONDS: Final = 300.0
"""Longest time for printing; a browser that takes longer hangs."""

_MILLISECONDS_OF_THE_PAGE: Final = 60_000
"""Budget of the page's virtual clock, which skips idle time: all figures are complete long before."""


def find_browser() -> str | None:
    """Return the program that can print a report, or None if there is none."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def write_pdf(source: str | Path | Recording | Comparison, path: str | Path, *, browser: str | None = None) -> Path:
    """Write the report of a recording, or of a comparison, as PDF.

    Parameters
    ----------
    source : str, Path, Recording or Comparison
        Recording or its path, or result of `compare`.
    path : str or Path
        Path of the PDF; an existing file is replaced when the new one is complete.
    browser : str or None
        Program of the Chromium family; None for the first found on the search path.

    Returns
    -------
    Path
        Path of the PDF.

    Raises
    ------
    InputError
        The recording cannot be read or has no playback, or `path` is a file of it.
    LabError
        There is no such browser, or it does not print.
    """
    if not isinstance(source, Comparison):
        source = source if isinstance(source, Recording) else open_recording(source)
    recordings = [entry.recording for entry in source.recordings] if isinstance(source, Comparison) else [source]
    require_other([Path(path)], read=[file for recording in recordings for file in recording.files])
    program = browser or find_browser()
    if program is None:
        raise LabError(
            f"No browser that prints a PDF is on the search path ({', '.join(BROWSERS)}); install one, or open the "
            "HTML report in any browser and print it there."
        )
    with tempfile.TemporaryDirectory(prefix="duralab-pdf-") as folder:
        page = Path(folder) / "report.html"
        if isinstance(source, Comparison):
            write_comparison(page, source)
        else:
            write_report(source, page)
        printed = Path(folder) / "report.pdf"
        _print(program, page, printed, profile=Path(folder) / "profile")
        with replace_when_complete(Path(path)) as temporary:
            shutil.copyfile(printed, temporary)
    return Path(path)


def _print(program: str, page: Path, printed: Path, *, profile: Path) -> None:
    arguments = [
        program,
        "--headless=new",
        "--disable-gpu",
        "--disable-background-networking",
        "--no-first-run",
        "--no-pdf-header-footer",
        f"--virtual-time-budget={_MILLISECONDS_OF_THE_PAGE}",
        f"--user-data-dir={profile}",
        f"--print-to-pdf={printed}",
        f"{page.as_uri()}#print",
    ]
    if getattr(os, "geteuid", lambda: 1)() == 0:
        # A browser's sandbox does not start for root; the browser only opens the page written here.
        arguments.insert(1, "--no-sandbox")
    try:
        done = subprocess.run(arguments, capture_output=True, timeout=PATIENCE_SECONDS, check=False)
    except OSError as error:
        raise LabError(f"The browser {program} cannot be started: {error.strerror or error}.") from error
    except subprocess.TimeoutExpired as error:
        raise LabError(f"The browser {program} did not print within {PATIENCE_SECONDS:g} s; try again.") from error
    if not printed.is_file() or not printed.read_bytes().startswith(b"%PDF-"):
        said = done.stderr.decode(errors="replace").strip().splitlines()
        reason = f"exit code {done.returncode}{': ' + said[-1] if said else ''}"
        raise LabError(
            f"The browser {program} printed nothing ({reason}); open the HTML report in a browser and print it there."
        )
