"""`duralab doctor`: what would keep a lab from working here."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer
from rich.text import Text

from duralab.cli.exit_codes import ExitCode
from duralab.cli.json_output import console_beside, write_json
from duralab.diagnosis import Severity, examine

_STYLES = {Severity.FINE: "green", Severity.WARNING: "bold yellow", Severity.PROBLEM: "bold red"}


def doctor(*, recordings: Path, as_json: bool) -> None:
    """Print what was found, and what to do about it.

    Raises
    ------
    typer.Exit
        With code 1 where no lab would work.
    """
    findings = examine(recordings)
    counts = {severity: sum(finding.severity is severity for finding in findings) for severity in Severity}
    console = console_beside(as_json)
    for finding in findings:
        state = (f"{finding.severity.value:<8}", _STYLES[finding.severity])
        console.print(Text.assemble(f"{finding.check:<15}", state, finding.sentence))
        if finding.remedy:
            console.print(Text(f"{'':<23}→ {finding.remedy}"))
    problems, warnings = counts[Severity.PROBLEM], counts[Severity.WARNING]
    console.print(f"{problems} problems, {warnings} warnings, {counts[Severity.FINE]} fine.", highlight=False)
    if as_json:
        write_json({"works": not problems, "findings": [asdict(finding) for finding in findings]})
    if problems:
        raise typer.Exit(int(ExitCode.FAILED))
