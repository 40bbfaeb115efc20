"""`duralab down`: the end of a lab that `duralab up` keeps running."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Connect, Json
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.processes import RunningLab


def down(
    endpoint: Connect = None,
    all_labs: Annotated[bool, typer.Option("--all", help="End every lab that `duralab up` keeps running.")] = False,
    as_json: Json = False,
) -> None:
    """End the lab that `duralab up` keeps running."""
    from duralab.processes import end_lab

    output = Output(as_json)
    labs = _chosen(endpoint, all_labs=all_labs)
    for lab in labs:
        with output.console.status(f"Ending the lab at {lab.endpoint} …"):
            end_lab(lab)
        output.say(f"The lab at {lab.endpoint} is down.")
    if not labs:
        output.say("No lab of yours runs on this machine.")
    output.document({"ended": [{"endpoint": lab.endpoint, "process_id": lab.process_id} for lab in labs]})


def _chosen(endpoint: str | None, *, all_labs: bool) -> list[RunningLab]:
    from duralab.processes import running_labs, the_running_lab

    if endpoint is not None and all_labs:
        raise InputError("--connect and --all exclude each other; give one of them.", field="connect")
    if all_labs:
        return running_labs()
    if endpoint is None:
        lab = the_running_lab()
        return [] if lab is None else [lab]
    labs = running_labs()
    if chosen := [lab for lab in labs if lab.endpoint == endpoint]:
        return chosen
    there = f"there are {', '.join(lab.endpoint for lab in labs)}" if labs else "there is none"
    raise InputError(
        f"No lab that you started on this machine with `duralab up` listens at {endpoint}; {there}.", field="connect"
    )
