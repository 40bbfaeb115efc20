"""Interlock of a rig: its mode, the latch of a stop, and the names of played runs. Safe for threads."""

from __future__ import annotations

import threading

from duralab_bus import FaultError
from duralab_proto.v1 import query_pb2, rig_pb2

#: Longest kept reason, and longest name of the person who resets; every state carries them.
LONGEST_REASON = 300
LONGEST_NAME = 80
#: A stop takes the rest of a block and a ramp: less than a second on the shipped rigs, several times that if Drake
#: plays slower than real time, and up to 20 s if a specimen's `approach` states so.
REST_SECONDS = 60.0
#: Number of remembered names of playbacks, and of ids of resets. They prevent the repetition of a query, which would
#: come within seconds; so old ones may be forgotten, and the memory of a rig that runs for months does not grow.
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
        """Number of trips so far."""
        self._run = ""
        self._mode: rig_pb2.RigMode = rig_pb2.RIG_MODE_IDLE
        self._awaited = ""
        self.fraction = 0.0
        """Played share of the run, 0 to 1."""
        self._stop = threading.Event()
        # A dict keeps the order of the names.
        self._runs: dict[str, None] = {}
        self._resets: dict[str, None] = {}

    def state(self) -> rig_pb2.RigState:
        """Return the state as a message; with a run until the rig rests, latched or not."""
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
        """Reserve the rig for a playback; `end` must follow."""
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
        """Set the mode of the present playback and what it waits for; return whether that is new."""
        with self._changed:
            was = self._mode, self._awaited
            self._mode, self._awaited = mode, awaited
            return was != (mode, awaited)

    def end(self) -> None:
        """Release the rig, at rest."""
        with self._changed:
            self._run, self.fraction, self._mode, self._awaited = "", 0.0, rig_pb2.RIG_MODE_IDLE, ""
            self._changed.notify_all()

    def trip(self, reason: str) -> str:
        """Latch, so that a present playback ramps down; the first reason is kept. Return this one, shortened."""
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
        """Wait for at most this time; return whether the playback must ramp down."""
        return self._stop.wait(seconds) if seconds > 0.0 else self._stop.is_set()

    def wait_for_rest(self) -> rig_pb2.RigState:
        """Wait until the rig plays nothing; return the state then."""
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
        """Clear the latch and keep the name and the reason; a rig that is not latched stays unchanged."""
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
