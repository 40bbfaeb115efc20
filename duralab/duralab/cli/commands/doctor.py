"""`duralab doctor`: what would keep a lab from working here."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Json
from duralab.cli.output import Output

_STYLES = {"FINE": "green", "WARNING": "bold yellow", "PROBLEM": "bold red"}
"""Styles of the severities, by the names of `Severity`."""


def doctor(
    *,
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Folder of the recordings, whose disk is checked.")
    ] = Path("recordings"),
    as_json: Json = False,
) -> None:
    """Check this machine for what keeps a lab from working, with a remedy for each finding."""
    from rich.text import Text

    from duralab.diagnosis import Severity, examine

    findings = examine(recordings)
    counts = {severity: sum(finding.severity is severity for finding in findings) for severity in Severity}
    output = Output(as_json)
    for finding in findings:
        state = (f"{finding.severity.value:<8}", _STYLES[finding.severity.name])
        output.console.print(Text.assemble(f"{finding.check:<15}", state, finding.sentence))
        if finding.remedy:
            output.console.print(Text(f"{'':<23}→ {finding.remedy}"))
    problems, warnings = counts[Severity.PROBLEM], counts[Severity.WARNING]
    output.say(f"{problems} problems, {warnings} warnings, {counts[Severity.FINE]} fine.")
    output.document({"works": not problems, "findings": [asdict(finding) for finding in findings]})
    if problems:
        raise typer.Exit(int(ExitCode.FAILED))
