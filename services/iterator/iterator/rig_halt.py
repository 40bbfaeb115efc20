"""Making sure that a rig rests after a playback was broken off."""

from __future__ import annotations

import time
from typing import Final

import structlog

from duralab_proto.v1 import rig_pb2
from labbus import Bus, FaultError

# A cancelled playback reaches the rig through the identifier too; it needs this long to be let go and ramp down.
_PATIENCE_SECONDS: Final = 2.0
_POLL_SECONDS: Final = 0.1
# A cancelled identification may still be about to play: a service learns of it 0.3 s after its client let go.
_REST_SECONDS: Final = 0.6
_SILENCE_SECONDS: Final = 2.0


def bring_to_rest(bus: Bus, rig: str, *, run: str, reason: str) -> bool:
    """Wait until a rig whose playback was cancelled rests; stop it, which latches it, where it plays on.

    Parameters
    ----------
    bus : Bus
        Where the rig is; nothing is done where it has left.
    rig : str
        Its name.
    run : str
        The playback that was cancelled; what others play is left alone.
    reason : str
        Why, in words; kept as the latch's reason.

    Returns
    -------
    bool
        False where it is not known whether the rig rests.
    """
    log = structlog.get_logger("iterator").bind(rig=rig)
    begun = time.monotonic()
    until, resting_since = begun + _PATIENCE_SECONDS, begun
    try:
        while bus.live("rig_sim", rig):
            state = bus.query(
                bus.keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState, silence_seconds=_SILENCE_SECONDS
            )
            now = time.monotonic()
            if state.run == run:
                # In whatever mode: a rig that is latched may still be on its way down.
                resting_since = now
            elif now - resting_since >= _REST_SECONDS or state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
                return True
            if now >= until and resting_since == now:
                log.warning("The rig went on after its playback was cancelled; it is stopped.", run=state.run)
                bus.query(bus.keys.rig_stop(rig), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)
                return True
            time.sleep(_POLL_SECONDS)
    except FaultError as fault:
        log.warning("It is not known whether the rig rests.", why=fault.message)
    return False
