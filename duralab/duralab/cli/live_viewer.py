"""The live viewer beside a lab."""

from __future__ import annotations

from contextlib import ExitStack

from duralab.cli.output import Output
from duralab.errors import InputError
from duralab.processes import GRPC_PORT, WEB_PORT, Viewer


def open_viewer(stack: ExitStack, output: Output) -> Viewer:
    """Open the live viewer until `stack` is closed and say where it is."""
    # Free ports where the usual ones are taken: a second lab with a viewer is no reason to refuse.
    try:
        viewer = Viewer(port=GRPC_PORT, web_port=WEB_PORT)
    except InputError:
        viewer = Viewer(port=0, web_port=0)
    stack.enter_context(viewer)
    say_where(viewer, output)
    return viewer


def say_where(viewer: Viewer, output: Output) -> None:
    """Say how to look at the viewer."""
    where = f"at {viewer.page} (open it in a browser)" if viewer.page else "in its own window"
    output.say(f"Live viewer: {where}")
