"""`duralab rigs` and `duralab reset`: the rigs of a lab, and the latch of one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Connect, Json, RigName, endpoint_if_any, endpoint_of_lab, open_lab
from duralab.cli.output import Output
from duralab.errors import InputError, LabError

if TYPE_CHECKING:
    from rich.table import Table

    from duralab.data import Channel, Rig


def rigs(endpoint: Connect = None, as_json: Json = False) -> None:
    """List the rigs with their channels, limits and sample rates, and the other shipped rigs."""
    from duralab.data import SENSOR_COLUMNS, sensor_rows
    from duralab.display import text_table
    from duralab.processes import shipped_rigs

    output = Output(as_json)
    endpoint = endpoint_if_any(endpoint)
    rigs: dict[str, Rig] = {}
    faults: dict[str, str] = {}
    with open_lab(output, endpoint) as lab:
        for name in lab.rig_names():
            try:
                rigs[name] = lab.describe(name)
            except LabError as error:
                # One that cannot be used hides none of the others.
                faults[name] = error.message
    others = {name: title for name, title in shipped_rigs().items() if name not in rigs and name not in faults}
    described = [_document(rig) for rig in rigs.values()]
    unusable = [{"name": name, "fault": fault} for name, fault in faults.items()]
    if output.document({"lab": endpoint, "rigs": described, "unusable": unusable, "shipped": others}):
        return
    for rig in rigs.values():
        output.console.print(_table(rig), soft_wrap=False)
        if sensors := sensor_rows(rig.responses):
            output.say(text_table(SENSOR_COLUMNS, sensors, left=len(SENSOR_COLUMNS)))
        output.say(*rig.overdue, style="yellow")
    for name, fault in faults.items():
        output.say(f"{name}: {fault}", style="red")
    if not rigs and not faults:
        output.say("There is no rig in this lab.")
    if others:
        output.say("Shipped as well; start them with duralab up --rig NAME [--rig NAME ...]:")
        output.say(*(f"  {name}: {title}" for name, title in others.items()))


def _document(rig: Rig) -> dict[str, object]:
    channels = {kind: [_channel(one) for one in getattr(rig, kind)] for kind in ("drives", "responses")}
    values = {name: value for name, value in vars(rig).items() if name != "static_response"}
    return {**values, **channels, "overdue": rig.overdue}


def _channel(channel: Channel) -> dict[str, object]:
    hidden = ("kind", "watchdog", "sensor", "calculated")
    shown = {name: value for name, value in vars(channel).items() if name not in hidden}
    sensor = {} if channel.sensor is None else {"sensor": vars(channel.sensor)}
    calculated = {"calculated": dict(channel.calculated)} if channel.calculated else {}
    rates = {name: shown[name] or None for name in ("slew_limit", "actuator_speed")}
    return {**shown, **rates, **sensor, **calculated}


def _table(rig: Rig) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

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


def reset(
    rig: RigName,
    *,
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Who resets it; kept in the rig's log.")] = "",
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why it may move again; kept in the rig's log.")
    ] = "",
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Clear the latch of an interlocked rig, after its cause is removed."""
    import secrets

    from duralab.lab import FIND_SECONDS, join_bus
    from duralab_bus import FaultError
    from duralab_proto.v1 import rig_pb2

    output = Output(as_json)
    with join_bus(endpoint_of_lab(endpoint)) as bus:
        try:
            key, state_key = bus.keys.rig_reset(rig), bus.keys.rig_state(rig)
        except ValueError as error:
            raise InputError(str(error), field="rig") from error
        try:
            bus.wait_for_live({("rig_sim", rig)}, FIND_SECONDS)
            before = bus.query(state_key, rig_pb2.StateRequest(), rig_pb2.RigState)
            request = rig_pb2.ResetRequest(command=secrets.token_hex(16), name=name, reason=reason)
            after = bus.query(key, request, rig_pb2.RigState)
        except FaultError as fault:
            if fault.field in ("name", "reason"):
                raise InputError(fault.message, field=fault.field) from fault
            raise LabError(fault.message, service=fault.service) from fault
    was = f"was interlocked ({before.reason})" if before.mode == rig_pb2.RIG_MODE_INTERLOCKED else "was not interlocked"
    now = rig_pb2.RigMode.Name(after.mode).removeprefix("RIG_MODE_").lower()
    output.say(f"{rig} {was}; it is {now} now.")
    output.document({"rig": rig, "reason": before.reason, "state": now})
