"""A rig that cannot be used, on the bus: whoever asks it anything is told why, in one sentence."""

from __future__ import annotations

from typing import NoReturn

from duralab_proto.v1 import query_pb2, rig_pb2
from labbus import Bus, Call, FaultError


def serve_refusal(bus: Bus, rig: str, reason: str) -> None:
    """Answer every query of a rig with the fault FAILED_PRECONDITION.

    Parameters
    ----------
    bus : Bus
        Where it would have been served.
    rig : str
        Its name.
    reason : str
        Why it cannot be used, one sentence.
    """

    def refuse(_request: object, _call: Call) -> NoReturn:
        raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"{rig} cannot be used: {reason}")

    keys = bus.keys
    for key, request in (
        (keys.rig_description(rig), rig_pb2.DescriptionRequest),
        (keys.rig_frf(rig), rig_pb2.RigFrfRequest),
        (keys.rig_play(rig), rig_pb2.PlayRequest),
        (keys.rig_stop(rig), rig_pb2.StopRequest),
        (keys.rig_reset(rig), rig_pb2.ResetRequest),
        (keys.rig_state(rig), rig_pb2.StateRequest),
    ):
        bus.serve(key, request, refuse)
