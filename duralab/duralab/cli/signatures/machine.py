"""`duralab doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Json


def doctor(
    *,
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Where recordings would go, for the disk's room.")
    ] = Path("recordings"),
    as_json: Json = False,
) -> None:
    """Look for what would keep a lab from working on this machine, and say what to do about it."""
    from duralab.cli.doctor_command import doctor as examine

    examine(recordings=recordings, as_json=as_json)
