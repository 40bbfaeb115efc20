"""Playback of a repeat on the rig: requested once, its response checked."""

from __future__ import annotations

import threading
import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_bus import Bus, FaultError
from duralab_proto.arrays import ArrayError, from_record, to_record
from duralab_proto.v1 import query_pb2, rig_pb2
from sequencer.endurance.plan import EndurancePlan

REFUSALS: Final = frozenset(
    {
        query_pb2.FAULT_CODE_INVALID_ARGUMENT,
        query_pb2.FAULT_CODE_BUSY,
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
        query_pb2.FAULT_CODE_PERMISSION_DENIED,
        query_pb2.FAULT_CODE_UNIMPLEMENTED,
    }
)
"""Fault codes of `play` after which the rig did not move, because it checks a request first."""

# A real rig may wait for a person, as a file rig does for a response, even over a long weekend.
_WEEK_SECONDS: Final = 7 * 24 * 3600.0
# A simulated rig waits for its processor only.
_SIMULATION_SECONDS: Final = 30.0
_SIMULATION_RATIO: Final = 20.0
# A repeat with an unknown end is never played again: a machine that is overloaded for some time must not cost one. The
# end of the rig's process or link is noticed at once nevertheless.
_SILENCE_SECONDS: Final = 60.0


class RigPlayback:
    """Rig of one endurance test; used by its thread. `cancel`: Event that interrupts a repeat."""

    def __init__(self, bus: Bus, plan: EndurancePlan, *, cancel: threading.Event) -> None:
        self._bus = bus
        self._plan = plan
        self._cancel = cancel
        self._slowest = 0.0

    def refusal(self) -> str:
        """Return why the rig cannot play now; empty if it can. Nothing is announced before."""
        rig = self._plan.spec.rig
        try:
            state = self._bus.query(self._bus.keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState)
        except FaultError as fault:
            return f"The rig does not answer: {fault.message}"
        if state.mode == rig_pb2.RIG_MODE_IDLE and not state.run:
            return ""
        if state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
            return f"The rig is interlocked ({state.reason.rstrip('.')}); see to the reason and reset it."
        return f"The rig plays run {state.run!r}, which is not of this test; wait for its end."

    def play(
        self, drive: NDArray[np.float64], *, run: str, repeat: int
    ) -> tuple[rig_pb2.PlayResult, NDArray[np.float64]]:
        """Play a drive once; return the answer and the response, shape (responses, samples)."""
        description, spec = self._plan.description, self._plan.spec
        seconds = drive.shape[1] / description.sample_rate
        begun = time.monotonic()
        played = self._bus.query(
            self._bus.keys.rig_play(spec.rig),
            rig_pb2.PlayRequest(
                run=run,
                drive=to_record(description.drives, description.sample_rate, drive),
                seed=repeat_seed(spec.seed, repeat),
                real_time=spec.real_time,
            ),
            rig_pb2.PlayResult,
            silence_seconds=_SILENCE_SECONDS,
            longest_seconds=self._longest_seconds(seconds),
            cancel=self._cancel,
        )
        self._slowest = max(self._slowest, (time.monotonic() - begun) / seconds)
        return played, _checked_response(played, run, drive.shape[1], description)

    def _longest_seconds(self, seconds: float) -> float:
        """Return the longest time to the end of a repeat: the bus holds memory of each repeat until then.

        The first repeat shows how slow a simulated rig is: playing time in seconds for a second of the drive.
        """
        if self._plan.description.simulated and self._slowest:
            return _SIMULATION_SECONDS + _SIMULATION_RATIO * max(1.0, self._slowest) * seconds
        return _WEEK_SECONDS + 2.0 * seconds


def repeat_seed(seed: int, repeat: int) -> int:
    """Return the seed of a simulated rig's random processes in a repeat: the first 64 bits of the seed sequence."""
    return int(np.random.SeedSequence([seed, repeat]).generate_state(1, np.uint64)[0])


def _checked_response(
    played: rig_pb2.PlayResult, run: str, samples: int, description: rig_pb2.RigDescription
) -> NDArray[np.float64]:
    """Return the response of a repeat; raises FaultError DATA_LOSS if it is not one of this rig."""
    try:
        channels, _, response = from_record(played.response, field="response")
    except ArrayError as error:
        raise FaultError(query_pb2.FAULT_CODE_DATA_LOSS, f"The rig answered no response: {error}") from error
    names = [channel.name for channel in description.responses]
    if played.run != run or [channel.name for channel in channels] != names or response.shape[1] != samples:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"The rig answered {response.shape[1]} samples of {len(channels)} channels of run {played.run!r} to run "
            f"{run!r} of {samples} samples; see whether it is the rig that the test was started on.",
        )
    return response
