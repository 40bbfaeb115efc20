"""A hold of a campaign or a test: one thread waits, another one brings the decision, which is stored between them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from duralab_bus.faults import FaultError
from duralab_bus.queries import Call
from duralab_proto.v1 import query_pb2

HoldT = TypeVar("HoldT")
DecisionT = TypeVar("DecisionT")

_POLL_SECONDS: Final = 0.1
_PROGRESS_SECONDS: Final = 1.0


@dataclass(frozen=True)
class _Brought(Generic[DecisionT]):
    decision: DecisionT
    stored: Future[None]


class OpenHold(Generic[HoldT, DecisionT]):
    """The hold that waits for its decision, if there is one.

    Parameters
    ----------
    stop : threading.Event
        Ends the waiting.
    """

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self._lock = threading.Lock()
        self._hold: HoldT | None = None
        self._brought: _Brought[DecisionT] | None = None
        self._is_brought = threading.Event()

    @property
    def hold(self) -> HoldT | None:
        """The open hold; None if nothing waits."""
        return self._hold

    def open(self, hold: HoldT) -> None:
        """Let decisions on a hold in; the caller then waits for one with `decided`."""
        with self._lock:
            self._is_brought.clear()
            self._hold, self._brought = hold, None

    def decided(self, store: Callable[[DecisionT], object]) -> DecisionT:
        """Wait for the decision on the open hold, store and return it.

        `store`: Stores it; the caller of `bring` is answered when this returns, with the error if it raises one.
        Raises `FaultError`: CANCELLED if it is stopped before a decision comes.
        """
        while not self._is_brought.wait(_POLL_SECONDS):
            if self._stop.is_set():
                with self._lock:
                    self._hold = None
                if self._brought is None:
                    raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        brought = self._brought
        if brought is None:
            raise AssertionError("The decision is set before its event.")
        try:
            store(brought.decision)
        except BaseException as error:
            brought.stored.set_exception(error)
            raise
        brought.stored.set_result(None)
        return brought.decision

    def bring(self, hold: HoldT, decision: DecisionT, call: Call, *, not_open: Callable[[], FaultError]) -> None:
        """Bring a checked decision on a hold, which is compared by identity; return when it is stored.

        `call`: Query that waits for the answer. `not_open`: Returns the fault for a hold that is not open any more.
        Raises `FaultError`: That of `not_open`, or why the decision could not be stored.
        """
        brought = _Brought(decision, Future[None]())
        with self._lock:
            if self._hold is not hold:
                raise not_open()
            self._hold, self._brought = None, brought
            self._is_brought.set()
        while True:
            try:
                return brought.stored.result(_PROGRESS_SECONDS)
            except TimeoutError:
                call.progress("storing the decision", 0.0)
