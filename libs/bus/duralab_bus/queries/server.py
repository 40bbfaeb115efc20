"""The server side of a bus: queryables, their workers, keep-alive and cancellation."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeVar

import structlog
import zenoh
from google.protobuf.message import Message

from duralab_bus.encoding import MessageT
from duralab_bus.faults import FaultError
from duralab_bus.metrics import NO_LABELS, Labels, Metrics
from duralab_bus.queries.call import Handler, QueryJob, RefusalLog
from duralab_bus.session import DEBOUNCE_SECONDS, BusSession, Declaration, Inbox
from duralab_bus.threads import BusThread
from duralab_proto.keys import ANY, Keys
from duralab_proto.v1 import query_pb2

PATIENCE_SECONDS: Final = 0.25
"""Time in seconds that a query waits for a worker before it is refused: long enough for a burst of short ones."""


MOST_WAITING: Final = 64
"""Number of waiting jobs at which `wait_for_room` blocks: more than a burst of legitimate queries."""


class Job(Protocol):
    """Unit of work of a worker."""

    def run(self) -> None:
        """Do the work; raises nothing."""
        ...


JobT = TypeVar("JobT", bound=Job)


class WorkerPool(Generic[JobT]):
    """Up to `workers` threads, started when needed; daemons, so that a stuck job does not keep the process alive.

    A job waits `patience_seconds` for a worker before `take_overdue` returns it; infinite if none is to be refused.
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
        """Number of jobs without a worker."""
        return len(self._waiting)

    def submit(self, job: JobT) -> bool:
        """Queue a job; never blocks. Returns False when the pool is closed."""
        with self._changed:
            if self._closed:
                return False
            self._waiting.append((time.monotonic() + self._patience_seconds, job))
            if self._idle < len(self._waiting) and self._started < self.workers:
                self._started += 1
                # Counted now, not when the thread starts: on a busy machine that takes time.
                self._idle += 1
                BusThread(self._run, name=f"{self._name}-{self._started}").start()
            self._changed.notify()
        return True

    def wait_for_room(self) -> None:
        """Wait while `MOST_WAITING` jobs wait: further queries stay in Zenoh's queue until the workers catch up."""
        with self._room:
            self._room.wait_for(lambda: self._closed or len(self._waiting) < MOST_WAITING)

    def take_overdue(self) -> list[JobT]:
        """Remove and return the jobs that waited too long for a worker.

        A job that has an idle worker is not among them: on a busy machine it takes time until the worker wakes up.
        """
        now = time.monotonic()
        overdue = []
        with self._changed:
            # The idle workers will take the first jobs.
            while len(self._waiting) > self._idle and self._waiting[self._idle][0] <= now:
                overdue.append(self._waiting[self._idle][1])
                del self._waiting[self._idle]
            self._room.notify_all()
        return overdue

    def finish(self) -> None:
        """Take no more jobs; the waiting ones are still done, then the threads end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._room.notify_all()

    def close(self) -> list[JobT]:
        """Start no more jobs; return those that were still waiting. Running jobs are not interrupted."""
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


_TICK_SECONDS: Final = 0.1
_DRAIN_SECONDS: Final = 1.5
_REMEMBERED_DEPARTURES: Final = 256
# A frozen peer reports nothing about its tokens; a running one answers within milliseconds.
_TOKEN_SECONDS: Final = 0.5
# Queries of one key that wait in Zenoh's memory. Zenoh's threads never wait for Python's lock: a flooded key does not
# block the others. If there are more, the oldest end without an answer.
_MOST_UNTAKEN: Final = 1024


@dataclass(frozen=True)
class _Route:
    """One served key expression."""

    expression: zenoh.KeyExpr
    request_type: type[Message]
    handler: Handler[Any]
    pool: WorkerPool[QueryJob[Any]]


class Served:
    """A key expression that is being served; made by `Bus.serve`, ended by `close`."""

    def __init__(self, server: QueryServer, route: _Route, inbox: Inbox[Any]) -> None:
        self._server = server
        self._route = route
        self._inbox = inbox
        self._closed = False

    def close(self) -> None:
        """Take no more queries; running ones continue."""
        if not self._closed:
            self._closed = True
            while (query := self._inbox.next_at_once()) is not None:
                self._server.take(self._route, query)
            self._inbox.undeclare()
            self._server.forget(self, self._route)


class QueryServer:
    """Server of the queries that one session receives; `workers` is the default number of threads of a key."""

    def __init__(
        self,
        session: BusSession,
        keys: Keys,
        *,
        service: str,
        workers: int,
        largest_bytes: int,
        metrics: Metrics,
    ) -> None:
        self._session = session
        self._keys = keys
        self._service = service
        self._largest_bytes = largest_bytes
        self._workers = workers
        self._pools: list[WorkerPool[QueryJob[Any]]] = []
        self._routes: list[_Route] = []
        self._served: set[Served] = set()
        self._changed = threading.Condition()
        self._jobs: dict[QueryJob[Any], _Route] = {}
        self._departures: dict[str, float] = {}
        self._departed: deque[str] = deque(maxlen=_REMEMBERED_DEPARTURES)
        self._askers: Declaration[Any] | None = None
        self._closed = False
        self._refusals = RefusalLog()
        self._log = structlog.get_logger("duralab_bus")
        self._answered = metrics.count(
            "duralab_queries_total", "Queries answered, by key and code", labels=("key", "code")
        )
        metrics.follow(
            "duralab_queries_running",
            "Queries whose handler runs or waits for a worker",
            self._running,
            labels=("key",),
        )
        metrics.follow("duralab_queries_waiting", "Queries that wait for a worker", self._waiting)

    def serve(
        self, key_expression: str, request_type: type[MessageT], handler: Handler[MessageT], *, workers: int | None
    ) -> Served:
        """Answer the queries on a key expression; see `Bus.serve`."""
        if self._askers is None:
            self._askers = self._session.declare(
                lambda joined: joined.liveliness().declare_subscriber(
                    # Present members are reported as well: a restored link brings them back.
                    self._keys.asking(ANY),
                    zenoh.handlers.Callback(self._on_asker, indirect=False),
                    history=True,
                )
            )
            BusThread(self._tick, name="duralab_bus-keep-alive").start()
        # Separate workers for each key: a client that floods one key does not block the others.
        pool: WorkerPool[QueryJob[Any]] = WorkerPool(
            workers or self._workers,
            name=f"duralab_bus-{request_type.DESCRIPTOR.name}",
            # Never refused: a client that repeats a stop has the same right to an answer.
            patience_seconds=PATIENCE_SECONDS if workers is None else math.inf,
        )
        route = _Route(zenoh.KeyExpr(key_expression), request_type, handler, pool)
        with self._changed:
            self._pools.append(pool)
            self._routes.append(route)
        inbox = self._session.receive(
            lambda joined: joined.declare_queryable(
                key_expression,
                zenoh.handlers.RingChannel(_MOST_UNTAKEN),
                # Complete: a query goes to one service only, even if two are started by mistake.
                complete=True,
            )
        )
        BusThread(self._take_all, route, inbox, name=f"duralab_bus-take-{request_type.DESCRIPTOR.name}").start()
        served = Served(self, route, inbox)
        with self._changed:
            self._served.add(served)
        return served

    def forget(self, served: Served, route: _Route) -> None:
        """Release a key expression that has ended; the waiting jobs of its pool are still done."""
        with self._changed:
            self._served.discard(served)
            if route in self._routes:
                self._routes.remove(route)
            if route.pool in self._pools:
                self._pools.remove(route.pool)
                route.pool.finish()

    def close(self) -> None:
        """Take no more queries, notify the running handlers, wait briefly, and answer for those that are stuck."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
            all_served, pools = list(self._served), list(self._pools)
        for served in all_served:
            served.close()
        if self._askers is not None:
            self._askers.undeclare()
        for pool in pools:
            for job in pool.close():
                job.refuse(self._ended(job.key))
        with self._changed:
            for job in self._jobs:
                job.cancel()
            self._changed.wait_for(lambda: not self._jobs, _DRAIN_SECONDS)
            stuck = list(self._jobs)
        for job in stuck:
            self._log.warning("A handler did not end in time.", key=job.key)
            job.refuse(self._ended(job.key))

    def _ended(self, key: str) -> FaultError:
        return FaultError(
            query_pb2.FAULT_CODE_UNAVAILABLE, f"The {self._service} ended before it answered {key}; start it again."
        )

    def _take_all(self, route: _Route, inbox: Inbox[Any]) -> None:
        while (query := inbox.next()) is not None:
            self.take(route, query)
            route.pool.wait_for_room()

    def take(self, route: _Route, query: zenoh.Query) -> None:
        """Take a query over from Zenoh."""
        with self._changed:
            outranked = self._outranked(route, query.key_expr)
        if outranked:
            query.drop()
            return
        job = QueryJob(
            query,
            request_type=route.request_type,
            handler=route.handler,
            service=self._service,
            largest_bytes=self._largest_bytes,
            refusals=self._refusals,
            on_end=lambda job: self._on_end(job, route),
        )
        with self._changed:
            self._jobs[job] = route
            departed = job.asker in self._departed
            self._changed.notify_all()
        if departed and not self._is_back(job.asker):
            job.cancel()
        if not route.pool.submit(job):
            job.refuse(self._ended(job.key))

    def _is_back(self, asker: str) -> bool:
        """Return whether a client that left is back: its token serves query after query, also over links that broke.

        Queried, because its return may be reported after its query has arrived.
        """
        token = self._keys.asking(ANY).removesuffix(ANY) + asker
        try:
            found = self._session.current.liveliness().get(token, timeout=_TOKEN_SECONDS)
            back = any(reply.ok is not None for reply in found)
        except zenoh.ZError:
            return False  # The session is closed: no member answers.
        if back:
            self._note_back(asker)
        return back

    def _note_back(self, asker: str) -> None:
        with self._changed:
            self._departures.pop(asker, None)
            if asker in self._departed:
                self._departed.remove(asker)

    def _outranked(self, route: _Route, key: zenoh.KeyExpr) -> bool:
        """Return whether a more specific expression is served for this key: `recording/list` before `recording/*`."""
        return any(
            other is not route
            and other.expression != route.expression
            and route.expression.includes(other.expression)
            and other.expression.includes(key)
            for other in self._routes
        )

    def _on_end(self, job: QueryJob[Any], route: _Route) -> None:
        self._answered.add(self._keys.within(str(route.expression)), job.code)
        with self._changed:
            self._jobs.pop(job, None)
            self._changed.notify_all()

    def _running(self) -> Mapping[Labels, float]:
        with self._changed:
            return Counter((self._keys.within(str(route.expression)),) for route in self._jobs.values())

    def _waiting(self) -> Mapping[Labels, float]:
        with self._changed:
            return {NO_LABELS: sum(pool.waiting for pool in self._pools)}

    def _on_asker(self, sample: zenoh.Sample) -> None:
        asker = str(sample.key_expr).rpartition("/")[2]
        if sample.kind == zenoh.SampleKind.PUT:
            # If its link flapped before its query arrived, this query must not be cancelled.
            self._note_back(asker)
            return
        with self._changed:
            if any(job.asker == asker for job in self._jobs):
                # Links flap: cancelled only after the token has been missing for DEBOUNCE_SECONDS.
                self._departures[asker] = time.monotonic() + DEBOUNCE_SECONDS
            else:
                self._departed.append(asker)

    def _tick(self) -> None:
        """Send progress to clients, refuse queries that wait too long, cancel those whose client has left."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs or self._closed)
                if self._is_done():
                    return
                now = time.monotonic()
                for asker in [asker for asker, until in self._departures.items() if until <= now]:
                    del self._departures[asker]
                    for job in self._jobs:
                        if job.asker == asker:
                            job.cancel()
                jobs = list(self._jobs)
                pools = list(self._pools)
            for job in jobs:
                job.keep_alive()
            for pool in pools:
                for overdue in pool.take_overdue():
                    overdue.refuse(
                        FaultError(
                            query_pb2.FAULT_CODE_BUSY,
                            f"All {pool.workers} workers of the {self._service} for it are taken; ask again later.",
                        )
                    )
            with self._changed:
                self._changed.wait_for(self._is_done, _TICK_SECONDS)

    def _is_done(self) -> bool:
        return self._closed and not self._jobs
