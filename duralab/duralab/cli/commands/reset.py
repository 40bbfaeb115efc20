"""`duralab reset`: clear the latch of a rig, after somebody has looked at it."""

from __future__ import annotations

from duralab.cli.choosing_lab import endpoint_of_lab
from duralab.cli.options import Connect, Json, RigName
from duralab.cli.output import Output
from duralab.errors import InputError, LabError


def reset(rig: RigName, endpoint: Connect = None, as_json: Json = False) -> None:
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
            after = bus.query(key, rig_pb2.ResetRequest(command=secrets.token_hex(16)), rig_pb2.RigState)
        except FaultError as fault:
            raise LabError(fault.message, service=fault.service) from fault
    was = f"was interlocked ({before.reason})" if before.mode == rig_pb2.RIG_MODE_INTERLOCKED else "was not interlocked"
    now = rig_pb2.RigMode.Name(after.mode).removeprefix("RIG_MODE_").lower()
    output.say(f"{rig} {was}; it is {now} now.")
    output.document({"rig": rig, "reason": before.reason, "state": now})
