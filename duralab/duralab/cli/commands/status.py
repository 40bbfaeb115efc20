"""`duralab status`: how a lab is, at a glance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Connect, Json
from duralab.cli.output import Output
from duralab.errors import LabError, UnavailableError

if TYPE_CHECKING:
    from rich.table import Table

    from duralab.lab import LabStatus, ServiceHealth

_FIGURES = {
    "duralab_queries_waiting": "waiting",
    "duralab_stream_lost_messages_total": "lost",
    "duralab_recorder_lag_seconds": "lag, s",
    "duralab_rig_real_time_factor": "× real time",
}
"""What is shown of each service that tells it, by the name that Prometheus knows too."""
_OF_A_RIG = "duralab_rig_"
_MEBIBYTE = 1024 * 1024
_STYLES = {"INTERLOCKED": "bold red", "UNKNOWN": "red", "PLAYING": "green"}
"""Styles of a rig's modes, by the names of `RigMode`."""


def status(endpoint: Connect = None, as_json: Json = False) -> None:
    """Show the services, rigs, running campaigns, recorder and disk of a lab."""
    from duralab.lab import join_bus, lab_status
    from duralab.processes import running_labs
    from duralab_bus import BusError

    output = Output(as_json)
    here = {lab.endpoint: Path(lab.recordings) for lab in running_labs()}
    asked = [endpoint] if endpoint is not None else list(here)
    documents, whole = [], bool(asked)
    for place in asked:
        try:
            with join_bus(place) as bus:
                found = lab_status(bus, recordings=here.get(place))
        except LabError as error:
            if endpoint is not None:
                if isinstance(error.__cause__, BusError):
                    # Asked whether a lab is there, that none is there is the answer, not a wrong value.
                    raise UnavailableError(error.message) from error
                raise
            documents.append({"endpoint": place, "fault": error.message})
            whole = False
            if not as_json:
                output.say(f"{place}: {error.message}", style="red")
            continue
        documents.append({"endpoint": place, "whole": found.whole, **asdict(found)})
        whole = whole and found.whole
        if not as_json:
            _print(output, place, found)
    if not output.document({"labs": documents}) and not asked:
        output.say("None of your labs runs on this machine; `duralab up` starts one.")
    if not whole:
        raise typer.Exit(int(ExitCode.FAILED))


def _print(output: Output, endpoint: str, found: LabStatus) -> None:
    output.say(f"Lab at {endpoint}", style="bold")
    if found.missing:
        output.say(f"Missing: {', '.join(found.missing)}.", style="bold red")
    tables = [_service_table(found), _rig_table(found), *([_campaign_table(found)] if found.campaigns else [])]
    for table in tables:
        output.console.print(table, soft_wrap=False)
    if not found.campaigns:
        output.say("No campaign is under way.")
    output.say(_recorder_sentence(found))


def _table(*folded: str, right: Sequence[str] = ()) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD)
    for heading in folded:
        table.add_column(heading, overflow="fold")
    for heading in right:
        table.add_column(heading, justify="right")
    return table


def _service_table(found: LabStatus) -> Table:
    from rich.markup import escape

    from duralab_proto.keys import MAIN_INSTANCE

    table = _table("service", right=("up", *_FIGURES.values()))
    table.add_column("trouble", overflow="fold")
    for health in found.services:
        name = health.service if health.instance == MAIN_INSTANCE else f"{health.service} {health.instance}"
        values = [_value(health, figure) for figure in _FIGURES]
        shown = ["" if value is None else f"{value:.3g}" for value in values]
        up = "" if math.isnan(health.up_seconds) else f"{timedelta(seconds=round(health.up_seconds))}"
        table.add_row(name, up, *shown, escape(health.trouble))
    return table


def _value(health: ServiceHealth, figure: str) -> float | None:
    """Return a figure of a service: of a rig its own, though all rigs of one process tell those of each other."""
    return health.value(figure, rig=health.instance) if figure.startswith(_OF_A_RIG) else health.value(figure)


def _rig_table(found: LabStatus) -> Table:
    from rich.markup import escape

    table = _table("rig", "state", "run", "why")
    for rig in found.rigs:
        how_far = f" {100 * rig.fraction:.0f} %" if rig.run else ""
        style = _STYLES.get(rig.mode.name, "")
        table.add_row(
            rig.rig,
            f"[{style}]{rig.mode}[/]" if style else rig.mode.value,
            escape(f"{rig.run}{how_far}"),
            escape(rig.why),
        )
    return table


def _campaign_table(found: LabStatus) -> Table:
    from rich.markup import escape

    from duralab.cli.run_display import remaining_words

    table = _table("campaign", "rig", "what it does", right=("done", "left", "playbacks", "error"))
    for campaign in found.campaigns:
        table.add_row(
            campaign.id,
            campaign.rig,
            escape(campaign.activity),
            f"{100 * campaign.fraction:.0f} %",
            remaining_words(campaign.remaining_seconds).removesuffix(" left"),
            str(campaign.playbacks),
            "" if campaign.error is None else f"{campaign.error:.3f}",
        )
    return table


def _recorder_sentence(found: LabStatus) -> str:
    recorder = found.recorder
    if recorder is None:
        return "The recorder does not answer."
    free = "" if recorder.free_bytes is None else f", {recorder.free_bytes / _MEBIBYTE:,.0f} MiB free on its disk"
    state = f"it waits: {recorder.waiting}" if recorder.waiting else f"{recorder.open_recordings} being written"
    return (
        f"Recorder: {recorder.recordings} recordings, {recorder.bytes / _MEBIBYTE:,.1f} MiB{free}; {state}; "
        f"{recorder.missing_blocks} signal blocks missing."
    )
