"""`duralab rigs`: which rigs there are, and what they are."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.json_output import write_json
from duralab.data import Channel, Rig
from duralab.errors import LabError
from duralab.processes import shipped_rigs


def list_rigs(*, endpoint: str | None, as_json: bool) -> None:
    """Print the rigs of a lab, and those that the simulator ships beside them."""
    endpoint = endpoint_if_any(endpoint)
    waiting = "Asking the lab …" if endpoint is not None else "Starting a lab of its own to ask …"
    rigs: dict[str, Rig] = {}
    faults: dict[str, str] = {}
    with Console(stderr=True).status(waiting), open_lab(endpoint) as lab:
        for name in lab.rig_names():
            try:
                rigs[name] = lab.describe(name)
            except LabError as error:
                # One that cannot be used hides none of the others.
                faults[name] = error.message
    others = {name: title for name, title in shipped_rigs().items() if name not in rigs and name not in faults}
    if as_json:
        described = [_document(rig) for rig in rigs.values()]
        unusable = [{"name": name, "fault": fault} for name, fault in faults.items()]
        write_json({"lab": endpoint, "rigs": described, "unusable": unusable, "shipped": others})
        return
    console = Console()
    for rig in rigs.values():
        console.print(_table(rig))
    for name, fault in faults.items():
        console.print(f"{name}: {fault}", style="red", highlight=False, markup=False)
    if not rigs and not faults:
        console.print("There is no rig in this lab.")
    if others:
        console.print("Shipped as well; start them with duralab up --rig NAME [--rig NAME ...]:", highlight=False)
        for name, title in others.items():
            console.print(f"  {name}: {title}", highlight=False, markup=False)


def _document(rig: Rig) -> dict[str, object]:
    return {
        "name": rig.name,
        "specimen": rig.specimen,
        "engine": rig.engine,
        "version": rig.version,
        "sample_rate": rig.sample_rate,
        "longest_drive_seconds": rig.longest_drive_seconds,
        "drives": [_channel(channel) for channel in rig.drives],
        "responses": [_channel(channel) for channel in rig.responses],
        "content_hash": rig.content_hash,
        "publishes_after_run": rig.publishes_after_run,
        "cannot_be_stopped": rig.cannot_be_stopped,
    }


def _channel(channel: Channel) -> dict[str, object]:
    return {
        "name": channel.name,
        "unit": channel.unit,
        "minimum": channel.minimum,
        "maximum": channel.maximum,
        "slew_limit": channel.slew_limit or None,
        "label": channel.label,
    }


def _table(rig: Rig) -> Table:
    table = Table(
        title=f"{rig.name}: {rig.specimen}",
        caption=f"{rig.sample_rate:g} Hz, drives up to {rig.longest_drive_seconds:g} s, engine {rig.engine} "
        f"{rig.version}{'; a run that has begun cannot be stopped' if rig.cannot_be_stopped else ''}",
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
