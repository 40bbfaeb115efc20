"""The early end of what commands a rig, a campaign or an endurance test: its rig halted, its fault in one sentence."""

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
    """Return the end of something that was stopped or failed.

    Parameters
    ----------
    fault : FaultError
        What ended it.
    what : str
        Its kind, e.g. "campaign".
    step : str
        What it did then, e.g. "identifying front_axle".
    service : str
        This service; named where the fault names none.
    stopped : str or None
        Why it was stopped; None if it failed.
    remedy : str
        Sentence that follows a failure.

    Returns
    -------
    EarlyEnd
        For the final status.
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
    """Bring a rig to rest, and latch it where `latch` is set; add to the final status where that failed.

    Parameters
    ----------
    bus : Bus
        Where the rig is.
    rig : str
        Its name.
    final : EndStatus
        Of what commanded it. Its fault says why; where it has none, `reason` does.
    run : str
        Run that was broken off; empty if the rig played none.
    reason : str
        Why it is stopped.
    latch : bool
        Latch it in every state.
    """
    why = final.fault.message or reason
    halt: Callable[..., str] = latch_rig if latch else bring_to_rest
    trouble = halt(bus, rig, run=run, reason=why) if run or latch else ""
    if trouble:
        final.activity += f"; {trouble}"
        if final.HasField("fault"):
            final.fault.message += f" {trouble[0].upper()}{trouble[1:]}."
