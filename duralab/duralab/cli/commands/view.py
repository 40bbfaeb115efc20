"""`duralab view`: the viewer on its own; and the viewer and the operator page beside a lab."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Json
from duralab.cli.output import Output

if TYPE_CHECKING:
    from duralab.lab import Lab
    from duralab.processes import OperatorPage, Viewer

_WATCH_SECONDS = 0.25


def view(
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="A live.rrd, or a recording.mcap to make one from.")
    ] = None,
    *,
    port: Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port for data.")] = 9876,
    web_port: Annotated[
        int, typer.Option("--web-port", metavar="N", min=0, max=65535, help="Port of the page.")
    ] = 9090,
    web: Annotated[bool, typer.Option("--web", help="Open a page in the browser, even with a display.")] = False,
    as_json: Json = False,
) -> None:
    """Open the Rerun viewer on 127.0.0.1, in a window or as a page for the browser, until Ctrl-C."""
    from tempfile import TemporaryDirectory

    from duralab.output_files import path_in, recording_in
    from duralab.processes import Viewer, is_recording, rebuilt_view

    output = Output(as_json)
    if file is not None:
        # The folder of a campaign stands for its live view.
        file = recording_in(path_in(file, "live.rrd"))
    with ExitStack() as stack:
        if file is not None and is_recording(file):
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="duralab-view-")))
            output.say("Making the live view again from the log …")
            file = rebuilt_view(file, folder / "live.rrd", report=output.say)
        viewer = stack.enter_context(Viewer(port=port, web_port=web_port, native=False if web else None, file=file))
        output.document({"address": viewer.address, "page": viewer.page}, on_one_line=True)
        say_where(viewer, output)
        output.say(f"It listens at {viewer.address}. Ctrl-C ends it.")
        while not viewer.wait(_WATCH_SECONDS):
            pass


def open_viewer(stack: ExitStack, output: Output) -> Viewer:
    """Open the live viewer until `stack` is closed, and print its address."""
    from duralab.errors import InputError
    from duralab.processes import Viewer

    # Free ports where the usual ones are taken: a second lab with a viewer is no reason to refuse.
    try:
        viewer = Viewer()
    except InputError:
        viewer = Viewer(port=0, web_port=0)
    stack.enter_context(viewer)
    say_where(viewer, output)
    return viewer


def open_page(stack: ExitStack, output: Output, lab: Lab, *, folder: Path, viewer: Viewer | None) -> OperatorPage:
    """Open the operator page of a lab until `stack` is closed, and print its address."""
    from duralab.errors import InputError
    from duralab.processes import PAGE_PORT, OperatorPage

    def opened(port: int) -> OperatorPage:
        shown, log = viewer.page if viewer is not None else None, folder / "logs" / "operator_page.log"
        return OperatorPage(lab.endpoints[0], folder=folder / "page", log=log, port=port, viewer=shown)

    with output.console.status("Starting the operator page …"):
        try:
            page = opened(PAGE_PORT)
        except InputError:
            page = opened(0)
    stack.enter_context(page)
    output.say(f"Operator page: {page.address} (open it in a browser)")
    return page


def say_where(viewer: Viewer, output: Output) -> None:
    """Say how to look at the viewer."""
    where = f"at {viewer.page} (open it in a browser)" if viewer.page else "in its own window"
    output.say(f"Live viewer: {where}")
