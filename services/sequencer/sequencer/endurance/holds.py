"""Holds before a repeat, requested by a person or caused by an alarm or a fault, and their decisions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from duralab_bus import Call, FaultError, OpenHold
from duralab_proto.v1 import query_pb2, sequencer_pb2
from sequencer.endurance.plan import invalid
from sequencer.endurance.test_log import EnduranceLog

_LONGEST_NAME: Final = 80
_LONGEST_REASON: Final = 1000


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
        self.last = last
        self._on_wait = on_wait
        self._asked = ""
        self._open = OpenHold[sequencer_pb2.EnduranceHold, sequencer_pb2.EnduranceDecision](stop)

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
        self._open.open(hold)
        self._on_wait(hold)
        return self._open.decided(self._store)

    def _store(self, decision: sequencer_pb2.EnduranceDecision) -> None:
        decision.decided = time.time_ns()
        self._log.commit(decision)
        self._on_wait(None)

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
        return self._open.hold

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
        hold = self._open.hold
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
        hold = self._open.hold
        if hold is None or hold.number != number:
            raise self._not_open(number)
        self._open.bring(hold, own, call, not_open=lambda: self._not_open(number))

    def _not_open(self, number: int) -> FaultError:
        """Return the fault for a late or repeated decision."""
        hold = self._open.hold
        waits = f"waits with hold {hold.number}" if hold else "does not wait now"
        return _refused(
            f"The decision is on hold {number} and endurance test {self._id!r} {waits}; look at its status, and decide "
            "on what it shows.",
            field="hold",
        )


def _refused(message: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, message, field=field)
