"""`duralab verify`: whether a recording is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.exit_codes import ExitCode
from duralab.cli.options import Connect, Json
from duralab.cli.output import Output
from duralab.errors import InputError


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
