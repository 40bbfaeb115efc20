"""`duralab up` and `duralab view`: what keeps running until it is told to end."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from duralab.cli.json_output import console_beside, write_json
from duralab.errors import InputError
from duralab.lab import DEFAULT_RIGS, start
from duralab.processes import (
    GRPC_PORT,
    WEB_PORT,
    Viewer,
    is_recording,
    noted,
    rebuilt_view,
    require_no_lab,
    require_shipped,
)

_WATCH_SECONDS = 0.25


def open_viewer(stack: ExitStack, console: Console) -> Viewer:
    """Open the live viewer for the length of `stack` and say where it is."""
    # Free ports where the usual ones are taken: a second lab with a viewer is no reason to refuse.
    try:
        viewer = Viewer(port=GRPC_PORT, web_port=WEB_PORT)
    except InputError:
        viewer = Viewer(port=0, web_port=0)
    stack.enter_context(viewer)
    _say_where(viewer, console)
    return viewer


def _say_where(viewer: Viewer, console: Console) -> None:
    where = f"at {viewer.page} (open it in a browser)" if viewer.page else "in its own window"
    console.print(f"Live viewer: {where}", highlight=False, markup=False)


def run_lab(
    *, listen: str, recordings: Path, rigs: Sequence[str] | None, real_time: bool, view: bool, as_json: bool
) -> None:
    """Run a lab until it is interrupted, or a service of it ends; with the usual rigs where none are named."""
    console = console_beside(as_json)
    require_shipped(rigs or (), usual=DEFAULT_RIGS)
    require_no_lab(listen, recordings=recordings)
    with ExitStack() as stack:
        viewer = open_viewer(stack, console) if view else None
        address = viewer.address if viewer is not None else None
        with console.status("Starting the lab …"):
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
        if as_json:
            write_json(
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
        console.print(f"The lab is up at {', '.join(lab.endpoints)}: {services}", highlight=False, markup=False)
        if real_time:
            console.print("The rigs play in real time, whatever is asked.")
        console.print(
            f"Recordings go to {recordings}/, logs to {recordings / 'logs'}/. Ctrl-C or `duralab down` ends it.",
            highlight=False,
            markup=False,
        )
        if fault is not None:
            console.print(fault, highlight=False, markup=False)
        while (ended := lab.failure()) is None:
            time.sleep(_WATCH_SECONDS)
        raise ended


def run_viewer(file: Path | None, *, port: int, web_port: int, web: bool, as_json: bool) -> None:
    """Run the viewer until it is closed or interrupted."""
    console = console_beside(as_json)
    with ExitStack() as stack:
        if file is not None and is_recording(file):
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="duralab-view-")))
            console.print("Making the live view again from the log …", highlight=False, markup=False)
            file = rebuilt_view(
                file, folder / "live.rrd", tell=lambda said: console.print(said, highlight=False, markup=False)
            )
        viewer = stack.enter_context(Viewer(port=port, web_port=web_port, native=False if web else None, file=file))
        if as_json:
            write_json({"address": viewer.address, "page": viewer.page}, on_one_line=True)
        _say_where(viewer, console)
        console.print(f"It listens at {viewer.address}. Ctrl-C ends it.", highlight=False, markup=False)
        while not viewer.wait(_WATCH_SECONDS):
            pass
