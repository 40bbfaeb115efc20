"""Early end of a campaign or an endurance test: its rig halted, its fault in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from duralab_bus.bus import Bus
from duralab_bus.commanding.rig_halt import bring_to_rest, latch_rig
from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2


class EndStatus(Protocol):
    """Final status of a campaign or an endurance test."""

    activity: str

    @property
    def fault(self) -> query_pb2.Fault:
        """Reason of the early end."""
        ...

    def HasField(self, field_name: str, /) -> bool:  # noqa: N802 - as protobuf names it
        """Return whether a field is set."""
        ...


@dataclass(frozen=True)
class EarlyEnd:
    """End before the last step: `activity` for the status, and the `fault`."""

    activity: str
    fault: query_pb2.Fault


def early_end(
    fault: FaultError, *, what: str, step: str, service: str, stopped: str | None, remedy: str = ""
) -> EarlyEnd:
    """Return the end of a campaign or test that was stopped or failed.

    Parameters
    ----------
    fault : FaultError
        Fault that ended it.
    what : str
        Kind of the work, e.g. "campaign".
    step : str
        Present step, e.g. "identifying front_axle".
    service : str
        Name of this service; used if the fault names none.
    stopped : str or None
        Reason of the stop; None if it failed.
    remedy : str
        Sentence that follows a failure.

    Returns
    -------
    EarlyEnd
        Activity and fault for the final status.
    """
    if stopped is not None:
        code, activity = query_pb2.FAULT_CODE_CANCELLED, f"stopped while {step}"
        sentence = f"The {what} was {activity}: {stopped.rstrip('.')}."
    else:
        code, activity = fault.code, f"failed while {step}"
        sentence = f"The {what} {activity}: {fault.message}" + (f" {remedy}" if remedy else "")
    named = fault.service or service
    return EarlyEnd(activity, query_pb2.Fault(code=code, message=sentence, field=fault.field, service=named))


def halt_rig(bus: Bus, rig: str, final: EndStatus, *, run: str, reason: str, latch: bool) -> None:
    """Bring a rig to rest, and latch it if `latch` is set; add a failure of that to the final status.

    Parameters
    ----------
    bus : Bus
        Bus of the rig.
    rig : str
        Name of the rig.
    final : EndStatus
        Final status of the commanding campaign or test. The reason is the message of its fault, or `reason` if empty.
    run : str
        Run that was aborted; empty if the rig played none.
    reason : str
        Reason of the stop.
    latch : bool
        Whether to latch the rig in every state.
    """
    why = final.fault.message or reason
    halt: Callable[..., str] = latch_rig if latch else bring_to_rest
    trouble = halt(bus, rig, run=run, reason=why) if run or latch else ""
    if trouble:
        final.activity += f"; {trouble}"
        if final.HasField("fault"):
            final.fault.message += f" {trouble[0].upper()}{trouble[1:]}."
