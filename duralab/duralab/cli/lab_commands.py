"""`duralab up`, `duralab rigs` and `duralab view`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from duralab._view_rebuilding import rebuilt_view
from duralab._viewer import GRPC_PORT, WEB_PORT, Viewer
from duralab.errors import InputError, LabError
from duralab.lab import Lab
from duralab.lab_opening import DEFAULT_RIGS, connect, start
from duralab.rig import Rig
from duralab.shipped_rigs import shipped_rigs
from duralab.signals import Channel

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


def run_lab(*, listen: str, recordings: Path, rigs: Sequence[str] | None, view: bool) -> None:
    """Run a lab until it is interrupted, or a service of it ends; with the usual rigs where none are named."""
    console = Console(soft_wrap=True)
    with ExitStack() as stack:
        viewer = open_viewer(stack, console) if view else None
        address = viewer.address if viewer is not None else None
        with console.status("Starting the lab …"):
            lab = stack.enter_context(
                start(recordings, listen=listen, recordings=recordings, rigs=rigs or DEFAULT_RIGS, viewer=address)
            )
        services = ", ".join(f"{name} ({pid})" for name, pid in lab.process_ids.items())
        console.print(f"The lab is up at {', '.join(lab.endpoints)}: {services}", highlight=False, markup=False)
        console.print(
            f"Recordings go to {recordings}/, logs to {recordings / 'logs'}/. Ctrl-C ends it.",
            highlight=False,
            markup=False,
        )
        while (ended := lab.failure()) is None:
            time.sleep(_WATCH_SECONDS)
        raise ended


def open_lab(endpoint: str | None) -> AbstractContextManager[Lab]:
    """Return the lab at an endpoint, or one of one's own where none is given."""
    return connect(endpoint) if endpoint is not None else start()


def list_rigs(*, endpoint: str | None) -> None:
    """Print the rigs of a lab, and those that the simulator ships beside them."""
    console = Console()
    waiting = "Asking the lab …" if endpoint is not None else "Starting a lab of its own to ask …"
    with ExitStack() as stack:
        with console.status(waiting):
            lab = stack.enter_context(open_lab(endpoint))
            names = lab.rig_names()
            for name in names:
                try:
                    console.print(_rig_table(lab.describe(name)))
                except LabError as error:
                    # One that cannot be used hides none of the others.
                    console.print(f"{name}: {error.message}", style="red", highlight=False, markup=False)
        if not names:
            console.print("There is no rig in this lab.")
        others = {name: title for name, title in shipped_rigs().items() if name not in names}
    if others:
        console.print("Shipped as well; start them with duralab up --rig NAME [--rig NAME ...]:", highlight=False)
        for name, title in others.items():
            console.print(f"  {name}: {title}", highlight=False, markup=False)


def _rig_table(rig: Rig) -> Table:
    table = Table(
        title=f"{rig.name}: {rig.specimen}",
        caption=f"{rig.sample_rate:g} Hz, drives up to {rig.longest_drive_seconds:g} s, engine {rig.engine} "
        f"{rig.version}",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("", "channel", "limits", "rate limit"):
        table.add_column(heading, no_wrap=True)
    table.add_column("what it is")
    for kind, channels in (("drive", rig.drives), ("response", rig.responses)):
        for channel in channels:
            slew = f"{channel.slew_limit:g} {channel.unit}/s" if channel.slew_limit else "–"
            table.add_row(kind, channel.name, _limits(channel), slew, channel.label)
        table.add_section()
    return table


def _limits(channel: Channel) -> str:
    if channel.minimum == -channel.maximum:
        return f"± {channel.maximum:g} {channel.unit}"
    return f"{channel.minimum:g} … {channel.maximum:g} {channel.unit}"


def run_viewer(file: Path | None, *, port: int, web_port: int, web: bool) -> None:
    """Run the viewer until it is closed or interrupted."""
    console = Console(soft_wrap=True)
    with ExitStack() as stack:
        if file is not None and file.suffix == ".mcap":
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="duralab-view-")))
            console.print("Making the live view again from the log …", highlight=False, markup=False)
            file = rebuilt_view(file, folder / "live.rrd")
        viewer = stack.enter_context(Viewer(port=port, web_port=web_port, native=False if web else None, file=file))
        _say_where(viewer, console)
        console.print(f"It listens at {viewer.address}. Ctrl-C ends it.", highlight=False, markup=False)
        while not viewer.wait(_WATCH_SECONDS):
            pass
