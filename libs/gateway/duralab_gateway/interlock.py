"""May the rig play: what it does, the latch of a stop, and the names that were played. Safe for threads."""

from __future__ import annotations

import threading

from duralab_bus import FaultError
from duralab_proto.v1 import query_pb2, rig_pb2

#: Longest reason that is kept, and longest name of who resets; they travel with every state.
LONGEST_REASON = 300
LONGEST_NAME = 80
#: A stop takes the rest of a block and a ramp: less than a second on the shipped rigs, several times that where Drake
#: plays slower than real time, and up to 20 s where a specimen's `approach` says so.
REST_SECONDS = 60.0
#: Names of so many playbacks, and ids of so many resets, are remembered. They guard against doing a query twice, which
#: would come within seconds; so old ones may be forgotten, and a rig that runs for months does not grow.
REMEMBERED_RUNS = 10_000


class Interlock:
    """Mode, latch and runs of one rig."""

    def __init__(self, rig: str) -> None:
        self._rig = rig
        self._changed = threading.Condition()
        self._latched = False
        self._reason = ""
        self._newest_reason = ""
        self._reset_name, self._reset_reason = "", ""
        self.trips = 0
        """How often it was tripped so far."""
        self._run = ""
        self._mode: rig_pb2.RigMode = rig_pb2.RIG_MODE_IDLE
        self._awaited = ""
        self.fraction = 0.0
        """Share of the run that is played, 0 to 1."""
        self._stop = threading.Event()
        # A dict keeps the order in which the names came.
        self._runs: dict[str, None] = {}
        self._resets: dict[str, None] = {}

    def state(self) -> rig_pb2.RigState:
        """Return the state as the contract puts it; with a run until it rests, latched or not."""
        with self._changed:
            return rig_pb2.RigState(
                rig=self._rig,
                mode=rig_pb2.RIG_MODE_INTERLOCKED if self._latched else self._mode,
                reason=self._reason if self._latched else self._awaited,
                run=self._run,
                fraction=self.fraction,
                reset_name=self._reset_name,
                reset_reason=self._reset_reason,
            )

    def begin(self, run: str) -> None:
        """Take the rig for a playback; `end` must follow."""
        with self._changed:
            if self._latched:
                raise FaultError(
                    query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                    f"{self._rig} is interlocked ({self._reason}); reset it before it plays.",
                )
            if self._run:
                raise FaultError(query_pb2.FAULT_CODE_BUSY, f"{self._rig} plays run {self._run!r}; wait until it ends.")
            if run in self._runs:
                raise FaultError(
                    query_pb2.FAULT_CODE_ALREADY_EXISTS,
                    f"run {run!r} was played on {self._rig} before; give every playback its own name.",
                    field="run",
                )
            _remember(self._runs, run)
            self._run, self.fraction, self._mode = run, 0.0, rig_pb2.RIG_MODE_SETTLING

    def enter(self, mode: rig_pb2.RigMode, *, awaited: str = "") -> bool:
        """Say what the playback under way does now, and what it waits for; return whether that is new."""
        with self._changed:
            was = self._mode, self._awaited
            self._mode, self._awaited = mode, awaited
            return was != (mode, awaited)

    def end(self) -> None:
        """Give the rig back, at rest."""
        with self._changed:
            self._run, self.fraction, self._mode, self._awaited = "", 0.0, rig_pb2.RIG_MODE_IDLE, ""
            self._changed.notify_all()

    def trip(self, reason: str) -> str:
        """Latch, so that a playback under way ramps down; the first reason stays. Return this one, shortened."""
        reason = reason or "stopped on request"
        with self._changed:
            self.trips += 1
            self._newest_reason = reason if len(reason) <= LONGEST_REASON else reason[:LONGEST_REASON] + "…"
            if not self._latched:
                self._latched, self._reason = True, self._newest_reason
                self._reset_name, self._reset_reason = "", ""
            self._stop.set()
            return self._newest_reason

    def wait_for_stop(self, seconds: float) -> bool:
        """Wait for at most so long; return whether the playback has to ramp down."""
        return self._stop.wait(seconds) if seconds > 0.0 else self._stop.is_set()

    def wait_for_rest(self) -> rig_pb2.RigState:
        """Wait until nothing plays; return the state then."""
        with self._changed:
            if not self._changed.wait_for(lambda: not self._run, REST_SECONDS):
                raise FaultError(
                    query_pb2.FAULT_CODE_DEADLINE_EXCEEDED,
                    f"{self._rig} must stop, but run {self._run!r} has not reached rest in {REST_SECONDS:g} s; "
                    "inspect the rig.",
                )
            return self.state()

    def claim(self, command: str) -> None:
        """Remember the id of a reset, so that it is done once."""
        with self._changed:
            if command in self._resets:
                raise FaultError(
                    query_pb2.FAULT_CODE_ALREADY_EXISTS,
                    f"the reset {command!r} of {self._rig} was done before; give every command its own id.",
                    field="command",
                )
            _remember(self._resets, command)

    def reset(self, *, seen: int, name: str = "", reason: str = "") -> None:
        """Clear the latch and keep who did it and why; a rig that is not latched stays unchanged."""
        with self._changed:
            if not self._latched:
                return
            if self.trips != seen:
                raise FaultError(
                    query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                    f"{self._rig} was stopped again while its reset waited ({self._newest_reason}); see to it and "
                    "reset it again.",
                )
            self._latched, self._reason = False, ""
            self._reset_name, self._reset_reason = name, reason
            self._stop.clear()


def _remember(names: dict[str, None], name: str) -> None:
    names[name] = None
    if len(names) > REMEMBERED_RUNS:
        del names[next(iter(names))]
