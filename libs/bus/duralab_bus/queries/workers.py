"""The threads that answer queries: a fixed number, and a short wait before a query is told that all are taken."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final, Generic, Protocol, TypeVar

PATIENCE_SECONDS: Final = 0.25
"""How long a query waits for a worker before it is refused: long enough for a burst of short ones."""


MOST_WAITING: Final = 64
"""Jobs that wait for a worker before `wait_for_room` waits: more than a burst of honest ones."""


class Job(Protocol):
    """What a worker does."""

    def run(self) -> None:
        """Do it; raises nothing."""
        ...


JobT = TypeVar("JobT", bound=Job)


class WorkerPool(Generic[JobT]):
    """Up to `workers` threads, started when needed; daemons, so that a stuck job does not keep the process alive.

    `workers`: 1 or more. `name`: Of the threads. `patience_seconds`: How long a job waits for a worker before
    `take_overdue` returns it; infinite where none is to be refused.
    """

    def __init__(self, workers: int, *, name: str, patience_seconds: float = PATIENCE_SECONDS) -> None:
        if workers < 1:
            raise ValueError(f"A pool of {workers} workers does nothing; it needs 1 or more.")
        self.workers = workers
        self._name = name
        self._patience_seconds = patience_seconds
        lock = threading.RLock()
        self._changed = threading.Condition(lock)
        self._room = threading.Condition(lock)
        self._waiting: deque[tuple[float, JobT]] = deque()
        self._started = 0
        self._idle = 0
        self._closed = False

    @property
    def waiting(self) -> int:
        """Number of jobs that no worker has yet."""
        return len(self._waiting)

    def submit(self, job: JobT) -> bool:
        """Queue a job; never blocks. Returns False when the pool is closed."""
        with self._changed:
            if self._closed:
                return False
            self._waiting.append((time.monotonic() + self._patience_seconds, job))
            if self._idle < len(self._waiting) and self._started < self.workers:
                self._started += 1
                # From now on, not from when the machine gets round to it: on a busy one that takes its time.
                self._idle += 1
                threading.Thread(target=self._run, name=f"{self._name}-{self._started}", daemon=True).start()
            self._changed.notify()
        return True

    def wait_for_room(self) -> None:
        """Wait while as many jobs wait as may: what comes faster than it is done is better left where it is."""
        with self._room:
            self._room.wait_for(lambda: self._closed or len(self._waiting) < MOST_WAITING)

    def take_overdue(self) -> list[JobT]:
        """Remove and return the jobs that waited too long for a worker.

        One that has an idle worker is not among them: on a busy machine it takes a while until the worker wakes up.
        """
        now = time.monotonic()
        overdue = []
        with self._changed:
            # The first of them are those that the idle ones will take.
            while len(self._waiting) > self._idle and self._waiting[self._idle][0] <= now:
                overdue.append(self._waiting[self._idle][1])
                del self._waiting[self._idle]
            self._room.notify_all()
        return overdue

    def finish(self) -> None:
        """Take nothing more; what waits is still done, then the threads end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._room.notify_all()

    def close(self) -> list[JobT]:
        """Start nothing more; return the jobs that were still waiting. Running jobs are not interrupted."""
        with self._changed:
            self._closed = True
            waiting = [job for _, job in self._waiting]
            self._waiting.clear()
            self._changed.notify_all()
            self._room.notify_all()
        return waiting

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                self._idle -= 1
                if not self._waiting:
                    return
                job = self._waiting.popleft()[1]
                self._room.notify_all()
            job.run()
            with self._changed:
                self._idle += 1
