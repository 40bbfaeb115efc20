"""`duralab check-rig`: does a rig keep the contract."""

from __future__ import annotations

from contextlib import ExitStack, suppress

import typer
from rich.console import Console
from rich.text import Text

from duralab.cli.choosing_lab import endpoint_if_any
from duralab.cli.exit_codes import ExitCode
from duralab.cli.json_output import write_json
from duralab.conformance import Finding, Outcome, all_passed, check_rig
from duralab.lab import FIND_SECONDS, join_bus, start
from labbus import FaultError

_SHOWN = {Outcome.PASSED: "green", Outcome.FAILED: "bold red", Outcome.NOT_TRIED: "dim"}


def check(rig: str, *, endpoint: str | None, as_json: bool) -> None:
    """Check a rig of a running lab, or of one of one's own, and print what was found.

    Raises
    ------
    typer.Exit
        With code 1 where the rig breaks the contract.
    """
    console = Console(soft_wrap=True)
    endpoint = endpoint_if_any(endpoint)
    with ExitStack() as stack:
        if endpoint is None:
            with Console(stderr=True).status("Starting a lab of its own …"):
                endpoint = stack.enter_context(start(rigs=(rig,))).endpoints[0]
        bus = stack.enter_context(join_bus(endpoint))
        # Where it is not on the bus, the first check says so.
        with suppress(FaultError):
            bus.wait_for_live({("rig_sim", rig)}, FIND_SECONDS)
        findings = check_rig(bus, rig, tell=None if as_json else lambda finding: console.print(_line(finding)))
    if as_json:
        write_json(_document(rig, findings))
    else:
        console.print(_summary(rig, findings))
    if not all_passed(findings):
        raise typer.Exit(int(ExitCode.FAILED))


def _line(finding: Finding) -> Text:
    outcome = (finding.outcome.value, _SHOWN[finding.outcome])
    return Text.assemble(f"{finding.check:<22}", (f"{outcome[0]:<10}", outcome[1]), finding.sentence)


def _summary(rig: str, findings: list[Finding]) -> str:
    counts = {outcome: sum(finding.outcome is outcome for finding in findings) for outcome in Outcome}
    verdict = "keeps" if all_passed(findings) else "breaks"
    return (
        f"{rig} {verdict} the contract: {counts[Outcome.PASSED]} passed, {counts[Outcome.FAILED]} failed, "
        f"{counts[Outcome.NOT_TRIED]} not tried."
    )


def _document(rig: str, findings: list[Finding]) -> dict[str, object]:
    return {
        "rig": rig,
        "passed": all_passed(findings),
        "findings": [
            {"check": finding.check, "outcome": finding.outcome.value, "sentence": finding.sentence}
            for finding in findings
        ],
    }
