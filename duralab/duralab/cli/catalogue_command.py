"""`duralab catalogue` and `duralab verify`: which recordings there are, and whether one is whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from textwrap import wrap
from typing import Final

import typer
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.exit_codes import ExitCode
from duralab.cli.json_output import write_json
from duralab.errors import InputError
from duralab.lab import CatalogueEntry, Result, connect
from duralab.processes import findings_of

_MEBIBYTE: Final = 1024 * 1024
_OPTIONS: Final = {"begun_from": "--from", "begun_before": "--before"}
_GAP: Final = 2
"""Columns between two of the table."""
_SHORTEST_TARGET: Final = 12
"""Characters of which a target still says something."""
_FOLDED_RESULT: Final = 11
_NO_LIMIT: Final = 100_000
"""Of a line that goes into a file or another program."""


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
    """Print the recordings of a lab that are looked for; an error names an option as it is typed."""
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
    if as_json:
        write_json([_plain(entry) for entry in entries])
        return
    console = Console()
    if entries:
        _show(entries, console)
    else:
        console.print("No recording fits.", highlight=False)


def _plain(entry: CatalogueEntry) -> dict[str, object]:
    return {**asdict(entry), "begun": None if entry.begun is None else entry.begun.isoformat()}


def _show(entries: Sequence[CatalogueEntry], console: Console) -> None:
    """Print them in lines as long as they must be: an id and a number are whole or of no use.

    The target gives way first: to a terminal it is shortened into what the others leave, or left out where that is next
    to nothing. Then times and results take two lines; then the lines are longer than the terminal.
    """
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
        said = f"The targets are left out, for which {columns} columns are too few; --json tells them."
        console.print(said, highlight=False, soft_wrap=True)


def _width(table: Table, console: Console) -> int:
    # What it would take without a limit.
    return console.measure(table, options=console.options.update(max_width=_NO_LIMIT)).maximum


def _table(entries: Sequence[CatalogueEntry], *, target_width: int, folded: bool = False) -> Table:
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


def verify(recording: str, *, endpoint: str | None, as_json: bool) -> None:
    """Have a recording of a lab, or its files, read from end to end and print what is wrong with it.

    Raises
    ------
    typer.Exit
        With code 1 where something is.
    InputError
        There is no such recording.
    """
    # No id holds a dot or a slash.
    of_files = "." in recording or "/" in recording
    findings = findings_of(Path(recording)) if of_files else _findings_of_lab(recording, endpoint)
    if as_json:
        write_json({"recording": recording, "whole": not findings, "findings": findings})
    else:
        console = Console(soft_wrap=True)
        for finding in findings:
            console.print(finding, highlight=False, markup=False)
        verdict = "is not whole." if findings else "is whole: every checksum, hash, step and signal block is in place."
        console.print(f"{recording} {verdict}", highlight=False, markup=False)
    if findings:
        raise typer.Exit(int(ExitCode.FAILED))


def _findings_of_lab(id: str, endpoint: str | None) -> list[str]:
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
