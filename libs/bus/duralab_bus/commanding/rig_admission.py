"""Check of whether a rig can play now."""

from __future__ import annotations

from duralab_bus.bus import Bus
from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2, rig_pb2


def described_rig(bus: Bus, rig: str) -> rig_pb2.RigDescription:
    """Return the description of a rig that can play now.

    Parameters
    ----------
    bus : Bus
        Bus of the rig.
    rig : str
        Name of the rig.

    Returns
    -------
    duralab.v1.RigDescription
        Description that the rig answers.

    Raises
    ------
    FaultError
        With the field `rig`: NOT_FOUND, FAILED_PRECONDITION for an interlocked rig, BUSY for one that plays.
    """
    keys = bus.keys
    try:
        description = bus.query(keys.rig_description(rig), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    except FaultError as fault:
        if fault.code != query_pb2.FAULT_CODE_UNAVAILABLE or bus.live("rig_sim", rig):
            raise
        raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, fault.message, field="rig") from fault
    state = bus.query(keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState)
    if state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Rig {rig!r} is interlocked ({state.reason}); see to the reason and reset it first.",
            field="rig",
        )
    if state.mode != rig_pb2.RIG_MODE_IDLE:
        raise FaultError(
            query_pb2.FAULT_CODE_BUSY, f"Rig {rig!r} plays run {state.run!r}; wait for its end.", field="rig"
        )
    return description
