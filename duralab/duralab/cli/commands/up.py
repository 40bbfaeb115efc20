"""`duralab up`: a lab that runs until it is ended."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Json, RealTime, complete_rig
from duralab.cli.output import Output

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
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer.")] = False,
    as_json: Json = False,
) -> None:
    """Start a lab on this machine and keep it running until Ctrl-C or `duralab down`."""
    from duralab.cli.live_viewer import open_viewer
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
                )
            )
        fault = stack.enter_context(noted(lab.endpoints[0], recordings=recordings, services=lab.process_ids))
        output.document(
            {
                "endpoints": lab.endpoints,
                "services": lab.process_ids,
                "recordings": recordings,
                "logs": recordings / "logs",
                "viewer": address,
            },
            on_one_line=True,
        )
        services = ", ".join(f"{name} ({pid})" for name, pid in lab.process_ids.items())
        output.say(f"The lab is up at {', '.join(lab.endpoints)}: {services}")
        if real_time:
            output.say("The rigs play in real time, whatever is asked.")
        output.say(f"Recordings go to {recordings}/, logs to {recordings / 'logs'}/. Ctrl-C or `duralab down` ends it.")
        if fault is not None:
            output.say(fault)
        while (ended := lab.failure()) is None:
            time.sleep(_WATCH_SECONDS)
        raise ended
