"""`duralab check-rig`: does a rig keep the contract."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import asdict
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
