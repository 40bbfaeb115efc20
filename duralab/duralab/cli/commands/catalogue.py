"""`duralab catalogue` and `duralab verify`: the recordings of a lab, and whether one is whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Final

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Connect, Json, endpoint_of_lab
from duralab.cli.output import Output
from duralab.errors import InputError
from duralab.lab import Result

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from duralab.lab import CatalogueEntry


_MEBIBYTE: Final = 1024 * 1024
_OPTIONS: Final = {"begun_from": "--from", "begun_before": "--before"}
_GAP: Final = 2
"""Columns between two of the table."""
_SHORTEST_TARGET: Final = 12
"""Characters of which a target still says something."""
_FOLDED_RESULT: Final = 11
_NO_LIMIT: Final = 100_000
"""Of a line that goes into a file or another program."""


def catalogue(
    *,
    rig: Annotated[str, typer.Option("--rig", metavar="NAME", help="Only recordings on this rig.")] = "",
    target: Annotated[
        str, typer.Option("--target", metavar="TEXT", help="Only recordings whose target source contains this text.")
    ] = "",
    begun_from: Annotated[
        datetime | None,
        typer.Option(
            "--from",
            metavar="TIME",
            help="Only recordings begun then or later, e.g. 2026-11-28 or 2026-11-28T07:00:00.",
        ),
    ] = None,
    begun_before: Annotated[
        datetime | None, typer.Option("--before", metavar="TIME", help="Only recordings begun before.")
    ] = None,
    result: Annotated[
        Result | None,
        typer.Option(
            "--result",
            metavar="RESULT",
            help=f"Only recordings with this result: {', '.join(each.value for each in Result)}.",
        ),
    ] = None,
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """List the recordings of a lab, or those that match the options."""
    from duralab.lab import connect

    with connect(endpoint_of_lab(endpoint)) as lab:
        try:
            entries = lab.catalogue.search(
                rig=rig, target=target, begun_from=begun_from, begun_before=begun_before, result=result
            )
        except InputError as error:
            option = _OPTIONS.get(error.field)
            if option is None:
                raise
            sentence = f"{option}{error.message.removeprefix(error.field)}"
            raise InputError(sentence, field=option, service=error.service) from error
    output = Output(as_json)
    begun = ({"begun": None if entry.begun is None else entry.begun.isoformat()} for entry in entries)
    if output.document([asdict(entry) | moment for entry, moment in zip(entries, begun, strict=True)]):
        return
    if entries:
        _show(entries, output)
    else:
        output.say("No recording fits.")


def _show(entries: Sequence[CatalogueEntry], output: Output) -> None:
    """Print them in lines as long as they must be: an id and a number are whole or of no use.

    The column of the target is shortened first: on a terminal to the width that the others leave, or left out where
    that is next to nothing. Then times and results take two lines; then the lines are longer than the terminal.
    """
    from rich.cells import cell_len

    console = output.console
    columns = console.width
    free = columns if console.is_terminal else _NO_LIMIT
    others = _width(_table(entries, target_width=0), console)
    longest = max(cell_len(text) for text in ("target", *(entry.target for entry in entries)))
    target_width = min(longest, free - others - _GAP)
    if target_width < min(longest, _SHORTEST_TARGET):
        target_width = 0
    table = _table(entries, target_width=target_width, folded=others > free)
    # Rich would cut what is longer than its console; a terminal breaks the line.
    console.width = max(columns, _width(table, console))
    console.print(table, soft_wrap=True)
    if not target_width:
        output.say(f"The targets are left out, for which {columns} columns are too few; --json contains them.")


def _width(table: Table, console: Console) -> int:
    # What it would take without a limit.
    return console.measure(table, options=console.options.update(max_width=_NO_LIMIT)).maximum


def _table(entries: Sequence[CatalogueEntry], *, target_width: int, folded: bool = False) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, padding=(0, 0 if folded else _GAP - 1, 0, 0), show_edge=False)
    for name in ("recording", "begun", "rig"):
        table.add_column(name, no_wrap=True)
    if target_width:
        table.add_column("target", no_wrap=True, overflow="ellipsis", max_width=target_width)
    table.add_column("result", no_wrap=True)
    for name in ("steps", "blocks", "missing", "MiB"):
        table.add_column(name, no_wrap=True, justify="right")
    for entry in entries:
        begun = "" if entry.begun is None else f"{entry.begun.astimezone():%Y-%m-%d %H:%M}"
        result = entry.result.value if entry.closed else f"waits: {entry.waiting}" if entry.waiting else "being written"
        table.add_row(
            Text(entry.id),
            begun.replace(" ", "\n") if folded else begun,
            Text(entry.rig),
            *([Text(entry.target)] if target_width else []),
            Text("\n".join(wrap(result, _FOLDED_RESULT)) if folded else result),
            str(entry.steps),
            str(entry.signal_blocks),
            str(entry.missing_blocks),
            f"{entry.bytes / _MEBIBYTE:.1f}",
        )
    return table


def verify(
    recording: Annotated[
        str,
        typer.Argument(metavar="ID|FILE", help="A closed recording of a lab, or a recording.mcap."),
    ],
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Read a recording from end to end: checksums, hashes, steps, signal blocks and the chain of its files."""
    from duralab.processes import findings_of

    # No id holds a dot or a slash.
    of_files = "." in recording or "/" in recording
    findings = findings_of(Path(recording)) if of_files else _findings_of_lab(recording, endpoint)
    output = Output(as_json)
    if not output.document({"recording": recording, "whole": not findings, "findings": findings}):
        verdict = "is not whole." if findings else "is whole: every checksum, hash, step and signal block is in place."
        output.say(*findings, f"{recording} {verdict}")
    if findings:
        raise typer.Exit(int(ExitCode.FAILED))


def _findings_of_lab(id: str, endpoint: str | None) -> list[str]:
    from duralab.lab import connect

    with connect(endpoint_of_lab(endpoint)) as lab:
        try:
            return lab.catalogue.verify(id)
        except InputError as error:
            if id in {entry.id for entry in lab.catalogue.search()}:
                raise
            sentence = (
                f"There is no recording {id!r}; `duralab catalogue` lists those there are, and the path of a "
                "recording.mcap has its files verified."
            )
            raise InputError(sentence, field="recording", service=error.service) from error
