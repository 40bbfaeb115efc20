"""State of a rig."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from duralab.errors import ended
from duralab_proto.v1 import rig_pb2


class RigMode(StrEnum):
    """Mode of a rig."""

    UNKNOWN = "unknown"
    IDLE = "idle"
    SETTLING = "settling"
    PLAYING = "playing"
    RAMPING_DOWN = "ramping down"
    WAITING = "waiting"
    INTERLOCKED = "interlocked"


_MODES: Final = MappingProxyType(
    {
        rig_pb2.RIG_MODE_IDLE: RigMode.IDLE,
        rig_pb2.RIG_MODE_SETTLING: RigMode.SETTLING,
        rig_pb2.RIG_MODE_PLAYING: RigMode.PLAYING,
        rig_pb2.RIG_MODE_RAMPING_DOWN: RigMode.RAMPING_DOWN,
        rig_pb2.RIG_MODE_WAITING: RigMode.WAITING,
        rig_pb2.RIG_MODE_INTERLOCKED: RigMode.INTERLOCKED,
    }
)


@dataclass(frozen=True)
class RigState:
    """Present state of a rig.

    Parameters
    ----------
    rig : str
        Name of the rig.
    mode : RigMode
        Mode; "interlocked" means latched until `Lab.reset`.
    reason : str
        Reason of the interlock, or condition that its run waits for; empty otherwise.
    run : str
        Name of the present run; the rig is at rest if and only if this is empty.
    fraction : float
        Played share of that run, 0 to 1.
    goes_on : bool
        Whether the rig is latched, but its run cannot be stopped and continues to its end; reported by `Lab.stop_rig`
        and `duralab status`.
    reset_name, reset_reason : str
        Name of the person who cleared the last latch, and reason; empty if not given, and while the rig is latched.
    """

    rig: str
    mode: RigMode
    reason: str
    run: str
    fraction: float
    goes_on: bool = False
    reset_name: str = ""
    reset_reason: str = ""

    @property
    def resting(self) -> bool:
        """Whether nothing moves."""
        return not self.run

    @classmethod
    def from_message(cls, message: rig_pb2.RigState, *, goes_on: bool = False) -> RigState:
        """Decode a state; a mode unknown to this version is `UNKNOWN`."""
        return cls(
            rig=message.rig,
            mode=_MODES.get(message.mode, RigMode.UNKNOWN),
            reason=message.reason,
            run=message.run,
            fraction=message.fraction,
            goes_on=goes_on,
            reset_name=message.reset_name,
            reset_reason=message.reset_reason,
        )

    @property
    def why(self) -> str:
        """Reason of the latch and, if its run continues nevertheless, a sentence about that."""
        if not self.warning:
            return self.reason
        return f"{ended(self.reason)} {self.warning}" if self.reason else self.warning

    @property
    def warning(self) -> str:
        """Sentence about a run that cannot be stopped; empty if there is none."""
        return f"The run {self.run!r} cannot be stopped and goes on to its end." if self.goes_on else ""

    def __str__(self) -> str:
        """Return the state as text."""
        run = f" {self.run} ({100 * self.fraction:.0f} %)" if self.run else ""
        reason = f": {self.why}" if self.why else ""
        return f"{self.rig} is {self.mode}{run}{reason}"
