"""`duralab check-rig`: does a rig keep the contract."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

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
    """Check that a rig keeps the contract; moves it by 5 % of its limits, twice for 2 s, stops and resets it."""
    from duralab.conformance import all_passed
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
    if not output.document(_document(rig, findings)):
        output.say(_summary(rig, findings))
    if not all_passed(findings):
        raise typer.Exit(int(ExitCode.FAILED))


def _line(finding: Finding) -> Text:
    from rich.text import Text

    outcome = (f"{finding.outcome.value:<10}", _STYLES[finding.outcome.name])
    return Text.assemble(f"{finding.check:<22}", outcome, finding.sentence)


def _summary(rig: str, findings: list[Finding]) -> str:
    from duralab.conformance import Outcome, all_passed

    counts = {outcome: sum(finding.outcome is outcome for finding in findings) for outcome in Outcome}
    verdict = "keeps" if all_passed(findings) else "breaks"
    return (
        f"{rig} {verdict} the contract: {counts[Outcome.PASSED]} passed, {counts[Outcome.FAILED]} failed, "
        f"{counts[Outcome.NOT_TRIED]} not tried."
    )


def _document(rig: str, findings: list[Finding]) -> dict[str, object]:
    from duralab.conformance import all_passed

    return {
        "rig": rig,
        "passed": all_passed(findings),
        "findings": [
            {"check": finding.check, "outcome": finding.outcome.value, "sentence": finding.sentence}
            for finding in findings
        ],
    }
