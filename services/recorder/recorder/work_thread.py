"""Thread that runs jobs one after the other."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

import structlog

from duralab_bus import SpanKind, span

ResultT = TypeVar("ResultT")


class WorkThread:
    """Runs the given jobs in order on one thread, so that the jobs need no lock.

    `name`: Name of the thread. `regularly`: Function called at least every `period_seconds`, between two jobs,
    regardless of their number. `period_seconds`: Greater than 0.
    """

    def __init__(self, name: str, *, regularly: Callable[[], None] | None = None, period_seconds: float = 0.25) -> None:
        self._name = name
        self._jobs: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self._regularly = regularly
        self._period = period_seconds
        self._lock = threading.Lock()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of jobs that are not begun."""
        return self._jobs.qsize()

    def call(self, job: Callable[[], ResultT]) -> Future[ResultT]:
        """Submit a job and return the future of its result, which is cancelled if the thread has ended."""
        future: Future[ResultT] = Future()

        def run() -> None:
            try:
                future.set_result(job())
            except BaseException as error:  # noqa: BLE001 - it is raised where the result is asked for
                future.set_exception(error)

        if not self.offer(run):
            future.cancel()
        return future

    def offer(self, job: Callable[[], object], *, most_waiting: int | None = None) -> bool:
        """Submit a job without a result; return False if it is not accepted."""
        if most_waiting is not None and self.waiting >= most_waiting:
            return False
        with self._lock:
            if self._closed:
                return False
            self._jobs.put(job)
        return True

    def close(self, timeout_seconds: float) -> bool:
        """Run the waiting jobs and end; return whether that was done in time."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._jobs.put(None)
        self._thread.join(timeout_seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        due = time.monotonic() + self._period
        while True:
            try:
                job = self._jobs.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                job = _nothing
            if job is None:
                return
            self._do(job)
            if time.monotonic() >= due:
                if self._regularly is not None:
                    self._do(self._regularly)
                due = time.monotonic() + self._period

    def _do(self, job: Callable[[], object]) -> None:
        try:
            with span(self._name, SpanKind.DISK):
                job()
        except Exception:  # noqa: BLE001 - one bad job must not end the thread that all others wait for
            structlog.get_logger("recorder").exception("A job failed by a defect.", thread=self._name)


def _nothing() -> None:
    """Do nothing: the job of an empty queue."""
