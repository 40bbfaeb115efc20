"""`duralab decide`: look at what a campaign proposes at a hold point, and decide on it."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from duralab.cli.options import CampaignId, Connect, Json, endpoint_of_lab
from duralab.cli.output import Output
from duralab.errors import InputError


class Choice(StrEnum):
    """Kind of decision."""

    PLAY = "play"
    CHANGE = "change"
    BACK = "back"
    END = "end"


def decide(
    id: CampaignId,
    choice: Annotated[Choice | None, typer.Argument(metavar="DECISION", help="Left out: show the proposal.")] = None,
    *,
    proposal: Annotated[int, typer.Option("--proposal", min=0, metavar="N", help="Number of the proposal.")] = 0,
    name: Annotated[
        str, typer.Option("--name", metavar="NAME", help="Name of the person who decides; kept in the recording.")
    ] = "",
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Reason; kept in the recording.")] = "",
    settings: Annotated[
        Path | None,
        typer.Option("--settings", metavar="FILE", help="change: YAML with the keys of update and control_band."),
    ] = None,
    values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="change: one key, e.g. update.iteration_gain=0.5; repeatable."),
    ] = None,
    from_iteration: Annotated[
        int, typer.Option("--from", min=0, metavar="N", help="back: playback to make the next drive from.")
    ] = 0,
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Decide on the playback that a campaign proposes at a hold point."""
    from duralab.lab import connect

    output = Output(as_json)
    if settings is not None and values:
        raise InputError("--settings and --set are given; give one of both.", field="settings")
    with connect(endpoint_of_lab(endpoint)) as lab:
        if choice is None:
            found = lab.proposal(id)
            output.say(f"Campaign {id} waits for no decision." if found is None else str(found))
            shown = None if found is None else {k: v for k, v in vars(found).items() if k not in ("drive", "predicted")}
            output.document({"campaign": id, "proposal": shown})
            return
        progress = lab.decide(
            id,
            choice.value,
            proposal=proposal,
            name=name,
            reason=reason,
            settings=settings if settings is not None else _nested(values) if values else None,
            from_iteration=from_iteration,
        )
    output.say(f"{id}: {choice.value}, decided by {name}; {progress.activity}")
    output.document({"campaign": id, "decision": choice.value, "activity": progress.activity})


def _nested(values: Sequence[str]) -> dict[str, Any]:
    """Return KEY=VALUE with dotted keys as nested settings; a value is YAML."""
    from duralab_settings import YamlError, parse_yaml

    nested: dict[str, Any] = {}
    for given in values:
        key, equals, text = given.partition("=")
        *sections, last = key.split(".")
        if not equals or not sections or not all((*sections, last)):
            raise InputError(
                f"--set is {given!r}; give SECTION.KEY=VALUE, e.g. update.iteration_gain=0.5.", field="set"
            )
        try:
            value = parse_yaml(text)
        except YamlError as error:
            raise InputError(f"--set {key} is not YAML: {error}; close brackets and quotes.", field="set") from error
        place = nested
        for section in sections:
            place = place.setdefault(section, {})
        place[last] = value
    return nested
