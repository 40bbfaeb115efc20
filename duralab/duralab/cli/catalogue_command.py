"""`duralab catalogue` and `duralab verify`: which recordings there are, and whether one is whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from duralab.catalogue import CatalogueEntry
from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.exit_codes import ExitCode
from duralab.cli.json_output import write_json
from duralab.lab_opening import connect
from duralab.recorded_result import Result

_MEBIBYTE = 1024 * 1024


def list_recordings(
    *,
    endpoint: str | None,
    rig: str,
    target: str,
    begun_from: datetime | None,
    begun_before: datetime | None,
    result: Result | None,
    as_json: bool,
) -> None:
    """Print the recordings of a lab that are looked for."""
    with connect(endpoint_of_lab(endpoint)) as lab:
        entries = lab.catalogue.search(
            rig=rig, target=target, begun_from=begun_from, begun_before=begun_before, result=result
        )
    if as_json:
        write_json([_plain(entry) for entry in entries])
        return
    console = Console()
    if entries:
        console.print(_table(entries))
    else:
        console.print("No recording fits.", highlight=False)


def _plain(entry: CatalogueEntry) -> dict[str, object]:
    return {**asdict(entry), "begun": None if entry.begun is None else entry.begun.isoformat()}


def _table(entries: Sequence[CatalogueEntry]) -> Table:
    table = Table(box=SIMPLE_HEAD)
    for name in ("recording", "begun", "rig"):
        table.add_column(name, no_wrap=True)
    # The longest of them: folded into what the others leave of a narrow terminal it would be a letter a line.
    table.add_column("target", no_wrap=True, overflow="ellipsis")
    table.add_column("result", no_wrap=True)
    for name in ("steps", "blocks", "missing", "MiB"):
        table.add_column(name, justify="right")
    for entry in entries:
        begun = "" if entry.begun is None else f"{entry.begun.astimezone():%Y-%m-%d %H:%M}"
        result = entry.result.value if entry.closed else f"waits: {entry.waiting}" if entry.waiting else "being written"
        table.add_row(
            entry.id,
            begun,
            entry.rig,
            entry.target,
            result,
            str(entry.steps),
            str(entry.signal_blocks),
            str(entry.missing_blocks),
            f"{entry.bytes / _MEBIBYTE:.1f}",
        )
    return table


def verify(id: str, *, endpoint: str | None, as_json: bool) -> None:
    """Have a recording read from end to end and print what is wrong with it.

    Raises
    ------
    typer.Exit
        With code 1 where something is.
    """
    with connect(endpoint_of_lab(endpoint)) as lab:
        findings = lab.catalogue.verify(id)
    if as_json:
        write_json({"recording": id, "whole": not findings, "findings": findings})
    else:
        console = Console(soft_wrap=True)
        for finding in findings:
            console.print(finding, highlight=False, markup=False)
        verdict = "is not whole." if findings else "is whole: every checksum, hash, step and signal block is in place."
        console.print(f"{id} {verdict}", highlight=False, markup=False)
    if findings:
        raise typer.Exit(int(ExitCode.FAILED))
