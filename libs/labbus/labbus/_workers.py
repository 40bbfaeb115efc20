"""The threads that answer queries: a fixed number, and a short wait before a query is told that all are taken."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final, Generic, Protocol, TypeVar

PATIENCE_SECONDS: Final = 0.25
"""How long a query waits for a worker before it is refused: long enough for a burst of short ones."""


class Job(Protocol):
    """What a worker does."""

    def run(self) -> None:
        """Do it; raises nothing."""
        ...


JobT = TypeVar("JobT", bound=Job)


class WorkerPool(Generic[JobT]):
    """Up to `workers` threads, started when needed; daemons, so that a stuck job does not keep the process alive.

    Parameters
    ----------
    workers : int
        1 or more.
    name : str
        Of the threads.
    patience_seconds : float
        How long a job waits for a worker before `take_overdue` returns it; infinite where none is to be refused.
    """

    def __init__(self, workers: int, *, name: str, patience_seconds: float = PATIENCE_SECONDS) -> None:
        if workers < 1:
            raise ValueError(f"A pool of {workers} workers does nothing; it needs 1 or more.")
        self.workers = workers
        self._name = name
        self._patience_seconds = patience_seconds
        self._changed = threading.Condition()
        self._waiting: deque[tuple[float, JobT]] = deque()
        self._started = 0
        self._idle = 0
        self._closed = False

    def submit(self, job: JobT) -> bool:
        """Queue a job; never blocks. Returns False when the pool is closed."""
        with self._changed:
            if self._closed:
                return False
            self._waiting.append((time.monotonic() + self._patience_seconds, job))
            if self._idle < len(self._waiting) and self._started < self.workers:
                self._started += 1
                threading.Thread(target=self._run, name=f"{self._name}-{self._started}", daemon=True).start()
            self._changed.notify()
        return True

    def take_overdue(self) -> list[JobT]:
        """Remove and return the jobs that waited too long for a worker."""
        now = time.monotonic()
        overdue = []
        with self._changed:
            while self._waiting and self._waiting[0][0] <= now:
                overdue.append(self._waiting.popleft()[1])
        return overdue

    def finish(self) -> None:
        """Take nothing more; what waits is still done, then the threads end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def close(self) -> list[JobT]:
        """Start nothing more; return the jobs that were still waiting. Running jobs are not interrupted."""
        with self._changed:
            self._closed = True
            waiting = [job for _, job in self._waiting]
            self._waiting.clear()
            self._changed.notify_all()
        return waiting

    def _run(self) -> None:
        while True:
            with self._changed:
                self._idle += 1
                self._changed.wait_for(lambda: self._waiting or self._closed)
                self._idle -= 1
                if not self._waiting:
                    return
                job = self._waiting.popleft()[1]
            job.run()
