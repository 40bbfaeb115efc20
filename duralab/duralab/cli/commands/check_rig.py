"""`duralab check-rig` and `duralab doctor`: does a rig keep the contract, and would a lab work here."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Connect, Json, RigName, endpoint_if_any, open_lab
from duralab.cli.output import Output

if TYPE_CHECKING:
    from rich.text import Text

    from duralab.conformance import Finding


_STYLES = {"PASSED": "green", "FAILED": "bold red", "NOT_TRIED": "dim"}
"""Styles of the outcomes, by the names of `Outcome`."""


def check_rig(rig: RigName, endpoint: Connect = None, as_json: Json = False) -> None:
    """Check that a rig keeps the contract; moves it by 1 % of its limits, twice for 2 s, stops and resets it."""
    from duralab.conformance import Outcome, all_passed
    from duralab.conformance import check_rig as check
    from duralab.lab import FIND_SECONDS, join_bus
    from duralab_bus import FaultError

    output = Output(as_json)
    endpoint = endpoint_if_any(endpoint)
    with ExitStack() as stack:
        if endpoint is None:
            endpoint = stack.enter_context(open_lab(output, None, rigs=(rig,))).endpoints[0]
        bus = stack.enter_context(join_bus(endpoint))
        # Where it is not on the bus, the first check says so.
        with suppress(FaultError):
            bus.wait_for_live({("rig_sim", rig)}, FIND_SECONDS)
        findings = check(bus, rig, tell=None if as_json else lambda finding: output.console.print(_line(finding)))
    found = [asdict(finding) for finding in findings]
    if not output.document({"rig": rig, "passed": all_passed(findings), "findings": found}):
        counts = {outcome: sum(finding.outcome is outcome for finding in findings) for outcome in Outcome}
        output.say(
            f"{rig} {'keeps' if all_passed(findings) else 'breaks'} the contract: {counts[Outcome.PASSED]} passed, "
            f"{counts[Outcome.FAILED]} failed, {counts[Outcome.NOT_TRIED]} not tried."
        )
    if not all_passed(findings):
        raise typer.Exit(int(ExitCode.FAILED))


def _line(finding: Finding) -> Text:
    from rich.text import Text

    outcome = (f"{finding.outcome.value:<10}", _STYLES[finding.outcome.name])
    return Text.assemble(f"{finding.check:<22}", outcome, finding.sentence)


_SEVERITY_STYLES = {"FINE": "green", "WARNING": "bold yellow", "PROBLEM": "bold red"}
"""Styles of the severities, by the names of `Severity`."""


def doctor(
    *,
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Folder of the recordings, whose disk is checked.")
    ] = Path("recordings"),
    as_json: Json = False,
) -> None:
    """Check if a lab can run on this machine; each finding has a remedy."""
    from rich.text import Text

    from duralab.diagnosis import Severity, examine

    findings = examine(recordings)
    counts = {severity: sum(finding.severity is severity for finding in findings) for severity in Severity}
    output = Output(as_json)
    for finding in findings:
        state = (f"{finding.severity.value:<8}", _SEVERITY_STYLES[finding.severity.name])
        output.console.print(Text.assemble(f"{finding.check:<15}", state, finding.sentence))
        if finding.remedy:
            output.console.print(Text(f"{'':<23}→ {finding.remedy}"))
    problems, warnings = counts[Severity.PROBLEM], counts[Severity.WARNING]
    output.say(f"{problems} problems, {warnings} warnings, {counts[Severity.FINE]} fine.")
    output.document({"works": not problems, "findings": [asdict(finding) for finding in findings]})
    if problems:
        raise typer.Exit(int(ExitCode.FAILED))
