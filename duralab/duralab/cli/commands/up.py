"""`duralab up` and `duralab down`: a lab that runs until it is ended."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Connect, Json, Page, RealTime, View, complete_rig
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.processes import RunningLab


_WATCH_SECONDS = 0.25


def up(
    *,
    listen: Annotated[
        str, typer.Option("--listen", metavar="ENDPOINT", help="Endpoint for clients.")
    ] = "tcp/127.0.0.1:7474",
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Folder for recordings and logs.")
    ] = Path("recordings"),
    rigs: Annotated[
        list[str] | None,
        typer.Option(
            "--rig",
            metavar="NAME",
            help="A shipped rig to start; repeatable.",
            autocompletion=complete_rig,
        ),
    ] = None,
    real_time: RealTime = False,
    view: View = False,
    page: Page = False,
    as_json: Json = False,
) -> None:
    """Start a lab on this machine and keep it running until Ctrl-C or `duralab down`."""
    from duralab.cli.commands.view import open_page, open_viewer
    from duralab.lab import DEFAULT_RIGS, start
    from duralab.processes import noted, require_no_lab, require_shipped

    output = Output(as_json)
    require_shipped(rigs or (), usual=DEFAULT_RIGS)
    require_no_lab(listen, recordings=recordings)
    with ExitStack() as stack:
        viewer = open_viewer(stack, output) if view else None
        address = viewer.address if viewer is not None else None
        with output.console.status("Starting the lab …"):
            lab = stack.enter_context(
                start(
                    recordings,
                    listen=listen,
                    recordings=recordings,
                    rigs=rigs or DEFAULT_RIGS,
                    viewer=address,
                    real_time=real_time,
                    endurance=True,
                )
            )
        opened = open_page(stack, output, lab, folder=recordings, viewer=viewer) if page else None
        fault = stack.enter_context(noted(lab.endpoints[0], recordings=recordings, services=lab.process_ids))
        output.document(
            {
                "endpoints": lab.endpoints,
                "services": lab.process_ids,
                "recordings": recordings,
                "logs": recordings / "logs",
                "viewer": address,
                "page": opened.address if opened is not None else None,
            },
            on_one_line=True,
        )
        services = ", ".join(f"{name} ({pid})" for name, pid in lab.process_ids.items())
        output.say(f"The lab is up at {', '.join(lab.endpoints)}: {services}")
        if real_time:
            output.say("All rigs play in real time.")
        output.say(f"Recordings go to {recordings}/, logs to {recordings / 'logs'}/. Ctrl-C or `duralab down` ends it.")
        if fault is not None:
            output.say(fault)
        while (ended := lab.failure()) is None:
            time.sleep(_WATCH_SECONDS)
        raise ended


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
        output.say("None of your labs runs on this machine.")
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
