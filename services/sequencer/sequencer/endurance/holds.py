"""Holds before a repeat, requested by a person or caused by an alarm or a fault, and their decisions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Final

from duralab_bus import Call, FaultError
from duralab_proto.v1 import query_pb2, sequencer_pb2
from sequencer.endurance.plan import invalid
from sequencer.endurance.test_log import EnduranceLog

_POLL_SECONDS: Final = 0.1
_PROGRESS_SECONDS: Final = 1.0
_LONGEST_NAME: Final = 80
_LONGEST_REASON: Final = 1000


@dataclass(frozen=True)
class _Answer:
    decision: sequencer_pb2.EnduranceDecision
    stored: Future[None]


class Holds:
    """Hold points of an endurance test. `wait` is called on the test's thread, other methods on any.

    `log`: Log of holds and decisions. `stop`: Event that ends the waiting. `last`: Number of the last hold so far.
    `on_wait`: Called with the hold when the test waits, and with None when it continues.
    """

    def __init__(
        self,
        id: str,
        *,
        log: EnduranceLog,
        stop: threading.Event,
        last: int,
        on_wait: Callable[[sequencer_pb2.EnduranceHold | None], None],
    ) -> None:
        self._id = id
        self._log = log
        self._stop = stop
        self.last = last
        self._on_wait = on_wait
        self._lock = threading.Lock()
        self._asked = ""
        self._open: sequencer_pb2.EnduranceHold | None = None
        self._answered = threading.Event()
        self._answer: _Answer | None = None

    def ask(self, reason: str) -> None:
        """Request a wait before the next repeat."""
        self._asked = reason

    @property
    def asked(self) -> str:
        """Reason to wait before the next repeat; empty if there is none."""
        return self._asked

    def wait(self, hold: sequencer_pb2.EnduranceHold, *, stored: bool = False) -> sequencer_pb2.EnduranceDecision:
        """Store a hold, wait for its decision, store and return the decision; raises FaultError CANCELLED on a stop."""
        if not stored:
            self.last += 1
            hold.number = self.last
            self._log.commit(hold)
        self._asked = ""
        with self._lock:
            self._answered.clear()
            self._open, self._answer = hold, None
        self._on_wait(hold)
        while not self._answered.wait(_POLL_SECONDS):
            if self._stop.is_set():
                with self._lock:
                    self._open = None
                if self._answer is None:
                    raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        answer = self._answer
        if answer is None:
            raise AssertionError("The answer is set before its event.")
        answer.decision.decided = time.time_ns()
        try:
            self._log.commit(answer.decision)
        except BaseException as error:
            answer.stored.set_exception(error)
            raise
        self._on_wait(None)
        answer.stored.set_result(None)
        return answer.decision

    def decided(
        self, hold: sequencer_pb2.EnduranceHold, kind: sequencer_pb2.EnduranceDecisionKind
    ) -> sequencer_pb2.EnduranceDecision:
        """Store a hold that the schedule decides, and its decision; return the decision."""
        self.last += 1
        hold.number = self.last
        self._log.commit(hold)
        decision = sequencer_pb2.EnduranceDecision(
            hold=hold.number, kind=kind, reason="action of the schedule", decided=time.time_ns()
        )
        self._log.commit(decision)
        return decision

    @property
    def open(self) -> sequencer_pb2.EnduranceHold | None:
        """The hold that the test waits with; None if it does not wait."""
        return self._open

    def decide(self, decision: sequencer_pb2.EnduranceDecision, call: Call) -> None:
        """Check a person's untrusted decision; return when it is stored."""
        for field, longest in (("name", _LONGEST_NAME), ("reason", _LONGEST_REASON)):
            said = getattr(decision, field)
            if not said.strip() or len(said) > longest:
                raise invalid(f"{field} has {len(said)} characters; give 1 to {longest}.", field=field)
        if decision.kind not in sequencer_pb2.EnduranceDecisionKind.values()[1:]:
            raise invalid(f"kind is {decision.kind}; continue, iterate again, relearn or end.", field="kind")
        self._take(decision.hold, decision, call)

    def resume(self, call: Call) -> None:
        """Continue after a hold by a person or a fault; return when it is stored."""
        hold = self._open
        if hold is None:
            raise _refused(f"Endurance test {self._id!r} does not wait; there is nothing to resume.", field="id")
        if hold.alarms:
            raise _refused(
                f"Endurance test {self._id!r} waits because of an alarm ({hold.reason.rstrip('.')}); decide on hold "
                f"{hold.number}, with a name and a reason.",
                field="hold",
            )
        decision = sequencer_pb2.EnduranceDecision(
            hold=hold.number, kind=sequencer_pb2.ENDURANCE_DECISION_KIND_CONTINUE, reason="resumed"
        )
        self._take(hold.number, decision, call)

    def _take(self, number: int, decision: sequencer_pb2.EnduranceDecision, call: Call) -> None:
        own = sequencer_pb2.EnduranceDecision()
        own.CopyFrom(decision)
        answer = _Answer(own, Future())
        with self._lock:
            if self._open is None or self._open.number != number:
                waits = f"waits with hold {self._open.number}" if self._open else "does not wait now"
                raise _refused(
                    f"The decision is on hold {number} and endurance test {self._id!r} {waits}; look at its status, "
                    "and decide on what it shows.",
                    field="hold",
                )
            self._open, self._answer = None, answer
            self._answered.set()
        while True:
            try:
                return answer.stored.result(_PROGRESS_SECONDS)
            except TimeoutError:
                call.progress("storing the decision", 0.0)


def _refused(message: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, message, field=field)
