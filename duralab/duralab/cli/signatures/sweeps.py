"""`duralab sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Json


def complete_sweep(incomplete: str) -> list[str]:
    """Return the shipped sweeps that begin so, for the shell; it completes files by itself."""
    from duralab.sweeps import shipped_sweeps

    return [name for name in shipped_sweeps() if name.startswith(incomplete)]


def sweep(
    sweep: Annotated[
        str | None,
        typer.Argument(
            help="A sweep file, or a shipped one: fifty_gains_and_seeds.",
            show_default=False,
            autocompletion=complete_sweep,
        ),
    ] = None,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Its folder; out/sweeps/<name> if left out.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Campaigns at once; one for each core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, tcp://….")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run those again that failed before.")] = False,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Only write the report of a sweep's folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run many campaigns, or go on with them, and compare them; needs duralab[sweeps]."""
    from duralab.cli.sweep_command import sweep as go

    go(
        sweep,
        out=out,
        workers=workers,
        scheduler=scheduler,
        retry_failed=retry_failed,
        report_of=report,
        as_json=as_json,
    )
