"""The workers of a sweep, here or those of a Dask scheduler, and the points on their way through them."""

from __future__ import annotations

import logging
import os
import re
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from duralab.errors import InputError, LabError
from duralab.sweeps.campaign_task import Task, close_cell, prepare_worker, run_point
from duralab.sweeps.points import Point, installed_versions
from duralab.sweeps.results import POINTS, Outcome, State, read_outcome, write_outcome
from duralab.sweeps.sweep_file import Sweep

if TYPE_CHECKING:
    from distributed import Client, Worker


_SCHEDULER: Final = re.compile(r"(tcp|tls)://[A-Za-z0-9._\-\[\]:]+:\d{1,5}")
CONNECT_SECONDS: Final = 15
WORKER_SECONDS: Final = 60


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def check_address(scheduler: str | None, *, workers: int | None) -> None:
    """Check which workers are asked for; raises InputError where that is none, or two things at once."""
    if scheduler is not None and workers is not None:
        raise InputError("--workers is of this machine and --scheduler brings its own; give one of them.")
    if scheduler is not None and not _SCHEDULER.fullmatch(scheduler):
        raise InputError(f"--scheduler is {scheduler!r}; give the address of a Dask scheduler, e.g. 'tcp://head:8786'.")


@contextmanager
def open_workers(folder: Path, *, workers: int | None, scheduler: str | None) -> Iterator[Client]:
    """Give a client of workers that run one campaign each at a time."""
    distributed = _imported()
    with ExitStack() as stack:
        if scheduler is None:
            private = stack.enter_context(tempfile.TemporaryDirectory(prefix="duralab-", ignore_cleanup_errors=True))
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers or cores(),
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=None,
                    local_directory=private,
                    silence_logs=logging.CRITICAL,
                )
            )
            client = stack.enter_context(distributed.Client(cluster))
        else:
            try:
                client = stack.enter_context(distributed.Client(scheduler, timeout=CONNECT_SECONDS))
                client.wait_for_workers(1, timeout=WORKER_SECONDS)
            except (OSError, TimeoutError) as error:
                raise LabError(
                    f"No scheduler with workers answers at {scheduler}; start `dask scheduler` and `dask worker`."
                ) from error
        # Fewer workers than cores may use what is left of them.
        _make_ready(client, folder, own_cores=scheduler is None and (workers or cores()) >= cores())
        yield client


def _imported() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError(f"A sweep needs Dask ({error.name} is not installed); install duralab[sweeps].") from error
    return distributed


def thread_counts(client: Client) -> dict[str, int]:
    """Return how many tasks each worker runs at once, by its address."""
    # Distributed types what it answers as a coroutine, which only an asynchronous client gets.
    answer: Any = client.nthreads()
    return dict(answer)


def _make_ready(client: Client, folder: Path, *, own_cores: bool) -> None:
    several = [address for address, threads in thread_counts(client).items() if threads != 1]
    if several:
        raise LabError(
            f"The worker {several[0]} runs several tasks at once; a rig cell belongs to one, so start every worker "
            "with `dask worker --nthreads 1`."
        )
    here = installed_versions()
    answers: Any = client.run(installed_versions)
    for address, there in answers.items():
        other = [f"{name} {there[name]} (here {here[name]})" for name in here if there[name] != here[name]]
        if other:
            raise LabError(f"The worker {address} has {', '.join(other)}; install the same everywhere.")
    client.register_plugin(_plugin(folder.resolve(), own_cores=own_cores), name="duralab-cell")


def _plugin(folder: Path, *, own_cores: bool) -> Any:
    from distributed import WorkerPlugin

    class Cell(WorkerPlugin):
        """Makes every worker ready, those that come later too, and ends its cell with it."""

        def setup(self, worker: Worker) -> None:
            if own_cores:
                _keep_to_core(int(worker.name))
            prepare_worker(folder)

        def teardown(self, worker: object) -> None:
            del worker
            close_cell()

    return Cell()


def _keep_to_core(number: int) -> None:
    """Let this process and those that it starts run on one core: a cell's threads lose a fifth by moving about."""
    if sys.platform == "linux":
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[number % len(allowed)]})


AHEAD = 2
"""Tasks for each worker that are with the scheduler: one that runs, one that follows it at once."""

RETRIES = 1
"""How often a campaign is run again whose worker died; the second time, the campaign is why."""


class PointRunner:
    """Runs points on the workers of a client, which is opened when there is something to run, and not before."""

    def __init__(
        self,
        open_client: Callable[[], Client],
        sweep: Sweep,
        *,
        folder: Path,
        retry_failed: bool,
        at_most: int | None = None,
    ) -> None:
        self._open_client = open_client
        self._sweep = sweep
        self._points = folder.resolve() / POINTS
        self._retry_failed = retry_failed
        self._at_most = at_most

    @cached_property
    def _client(self) -> Client:
        return self._open_client()

    def run(self, points: Sequence[Point]) -> Generator[tuple[Point, Outcome]]:
        """Yield every point with what became of it: first those that have ended, the others as they end.

        Of the others, only the first `at_most` where that is given.
        """
        waiting: deque[Point] = deque()
        twins: dict[str, list[Point]] = {}
        for point in points:
            ended = self._ended(point)
            if ended is not None:
                yield point, ended
            elif point.id in twins:
                # The same campaign under other settings, e.g. a gain that a schedule makes equal: once is enough.
                twins[point.id].append(point)
            else:
                twins[point.id] = [point]
                waiting.append(point)
        if self._at_most is not None:
            waiting = deque(islice(waiting, self._at_most))
        for point, outcome in self._outcomes(waiting) if waiting else ():
            for twin in twins[point.id]:
                yield twin, outcome

    def _ended(self, point: Point) -> Outcome | None:
        outcome = read_outcome(self._points / point.id)
        return None if outcome is not None and outcome.state is State.FAILED and self._retry_failed else outcome

    def _outcomes(self, waiting: deque[Point]) -> Generator[tuple[Point, Outcome]]:
        from distributed import as_completed

        client = self._client
        running: dict[Any, Point] = {}
        completed = as_completed(loop=client.loop)

        def submit() -> None:
            point = waiting.popleft()
            task = Task(point, self._points / point.id, self._sweep.cell, self._sweep.keep)
            # The key holds more than the id: a point that is retried is a task of its own.
            future = client.submit(run_point, task, pure=False, retries=RETRIES)
            running[future] = point
            completed.add(future)

        while waiting and len(running) < AHEAD * len(thread_counts(client)):
            submit()
        try:
            for future in completed:
                point = running.pop(future)
                outcome = self._outcome(point, future)
                if waiting:
                    submit()
                yield point, outcome
        finally:
            client.cancel(list(running))

    def _outcome(self, point: Point, future: Any) -> Outcome:
        if future.cancelled():
            raise LabError("The scheduler abandoned the campaigns; see its log, and run the sweep again to continue.")
        error = future.exception()
        if error is None:
            return future.result()
        message = " ".join(str(error).split()) or type(error).__name__
        sentence = f"The worker could not bring the campaign to its end: {message.rstrip('.')}."
        outcome = Outcome(point.id, State.FAILED, sentence)
        write_outcome(outcome, self._points / point.id)
        return outcome
