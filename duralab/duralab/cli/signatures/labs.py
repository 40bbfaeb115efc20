"""`duralab up`, `down`, `status` and `view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Connect, Json, RealTime, complete_rig


def up(
    *,
    listen: Annotated[
        str, typer.Option("--listen", metavar="ENDPOINT", help="Where clients connect.")
    ] = "tcp/127.0.0.1:7474",
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Where recordings and logs go.")
    ] = Path("recordings"),
    rig: Annotated[
        list[str] | None,
        typer.Option(
            "--rig",
            metavar="NAME",
            help="A shipped rig to start; give it again for more of them.",
            autocompletion=complete_rig,
        ),
    ] = None,
    real_time: RealTime = False,
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer beside it.")] = False,
    as_json: Json = False,
) -> None:
    """Start a lab on this machine and keep it running until Ctrl-C or `duralab down`."""
    from duralab.cli.lab_commands import run_lab

    run_lab(listen=listen, recordings=recordings, rigs=rig, real_time=real_time, view=view, as_json=as_json)


def down(
    connect: Connect = None,
    all_labs: Annotated[bool, typer.Option("--all", help="End every lab that `duralab up` keeps running.")] = False,
    as_json: Json = False,
) -> None:
    """End the lab that `duralab up` keeps running, and say when it is gone."""
    from duralab.cli.down_command import down as end

    end(endpoint=connect, all_labs=all_labs, as_json=as_json)


def status(connect: Connect = None, as_json: Json = False) -> None:
    """Show a lab's services, rigs and their states, campaigns under way, recorder and disk."""
    from duralab.cli.status_command import status as show

    show(endpoint=connect, as_json=as_json)


def view(
    file: Annotated[Path | None, typer.Argument(help="A live.rrd, or a recording.mcap to make one of.")] = None,
    *,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Where data are sent to it.")] = 9876,
    web_port: Annotated[int, typer.Option("--web-port", min=0, max=65535, help="Where a browser finds it.")] = 9090,
    web: Annotated[bool, typer.Option("--web", help="A page for the browser, even where there is a display.")] = False,
    as_json: Json = False,
) -> None:
    """Open the Rerun viewer on 127.0.0.1, in a window or as a page for the browser, until Ctrl-C."""
    from duralab.cli.lab_commands import run_viewer

    run_viewer(file, port=port, web_port=web_port, web=web, as_json=as_json)
