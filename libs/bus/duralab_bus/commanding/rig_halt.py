"""Rest of a rig after an aborted playback, and its latch after a stop."""

from __future__ import annotations

import time
from typing import Final

import structlog

from duralab_bus.bus import Bus
from duralab_bus.faults import FaultError
from duralab_proto.v1 import rig_pb2

# A cancelled playback also reaches the rig through the identifier; it needs this time to be released and ramp down.
_PATIENCE_SECONDS: Final = 2.0
_POLL_SECONDS: Final = 0.1
# A cancelled identification may still be about to play: a service notices 0.3 s after its client withdrew.
_REST_SECONDS: Final = 0.6
_SILENCE_SECONDS: Final = 2.0
_UNKNOWN: Final = "it is not known whether the rig rests; look at it"


def latch_rig(bus: Bus, rig: str, *, run: str, reason: str) -> str:
    """Stop a rig in every state: it ramps down if it plays, and is latched in any case.

    Parameters
    ----------
    bus : Bus
        Bus of the rig.
    rig : str
        Name of the rig.
    run : str
        Run that the caller waits for; a rig that plays another one is left alone. Empty if it waits for none.
    reason : str
        Reason as text; the rig keeps it.

    Returns
    -------
    str
        State of the rig afterwards, as text; empty if it rests.
    """
    try:
        state = _state_of(bus, rig)
        if state.run not in ("", run):
            return f"{rig} plays {state.run!r}, which nothing here waits for, and was not stopped"
        return _stopped(bus, rig, reason=reason)
    except FaultError as fault:
        return _unknown(rig, fault)


def bring_to_rest(bus: Bus, rig: str, *, run: str, reason: str) -> str:
    """Wait until a rig whose playback was cancelled rests; stop it, which latches it, if it continues to play.

    Parameters
    ----------
    bus : Bus
        Bus of the rig.
    rig : str
        Name of the rig.
    run : str
        Run that was cancelled.
    reason : str
        Reason of the stop if the rig continues to play.

    Returns
    -------
    str
        State of the rig afterwards, as text; empty if it rests.
    """
    begun = time.monotonic()
    until, resting_since = begun + _PATIENCE_SECONDS, begun
    try:
        while bus.live("rig_sim", rig):
            state = _state_of(bus, rig)
            now = time.monotonic()
            if state.run == run:
                # In any mode: a rig that is latched may still ramp down.
                resting_since = now
            elif now - resting_since >= _REST_SECONDS or state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
                return ""
            if now >= until and resting_since == now:
                return _stopped(bus, rig, reason=reason)
            time.sleep(_POLL_SECONDS)
    except FaultError as fault:
        return _unknown(rig, fault)
    return _UNKNOWN


def _state_of(bus: Bus, rig: str) -> rig_pb2.RigState:
    return bus.query(
        bus.keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState, silence_seconds=_SILENCE_SECONDS
    )


def _stopped(bus: Bus, rig: str, *, reason: str) -> str:
    """Stop a rig; return its remaining problem as text, empty if it rests."""
    state = bus.query(bus.keys.rig_stop(rig), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)
    structlog.get_logger("duralab_bus").warning("The rig was stopped.", rig=rig, reason=reason, goes_on=state.run)
    if state.run:
        # The contract: only a rig that cannot be stopped answers before it rests.
        return f"the run {state.run!r} cannot be stopped and goes on to its end, and {rig} is latched from then on"
    return ""


def _unknown(rig: str, fault: FaultError) -> str:
    structlog.get_logger("duralab_bus").warning("It is not known whether the rig rests.", rig=rig, why=fault.message)
    return _UNKNOWN
