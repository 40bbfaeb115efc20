"""Workers of a sweep, on this machine or of a Dask scheduler, and the running of points on them."""

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
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def check_address(scheduler: str | None, *, workers: int | None) -> None:
    """Check the options for workers; raises InputError for a wrong address, or if both options are given."""
    if scheduler is not None and workers is not None:
        raise InputError("--workers is of this machine and --scheduler brings its own; give one of them.")
    if scheduler is not None and not _SCHEDULER.fullmatch(scheduler):
        raise InputError(f"--scheduler is {scheduler!r}; give the address of a Dask scheduler, e.g. 'tcp://head:8786'.")


@contextmanager
def open_workers(folder: Path, *, workers: int | None, scheduler: str | None) -> Iterator[Client]:
    """Yield a client of workers that each run one campaign at a time."""
    distributed = _imported()
    with ExitStack() as stack:
        if scheduler is None:
            from dask import config

            private = stack.enter_context(tempfile.TemporaryDirectory(prefix="duralab-", ignore_cleanup_errors=True))
            # Distributed's profiler keeps the call stacks of an hour: 47 KB a second in each worker.
            stack.enter_context(config.set({"distributed.worker.profile.enabled": False}))
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
        # With fewer workers than cores, the workers may use the remaining cores.
        _make_ready(client, folder, own_cores=scheduler is None and (workers or cores()) >= cores())
        yield client


def _imported() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError(f"A sweep needs Dask ({error.name} is not installed); install duralab[sweeps].") from error
    return distributed


def thread_counts(client: Client) -> dict[str, int]:
    """Return the number of simultaneous tasks of each worker, by its address."""
    # The type hints of Distributed are a coroutine, which only an asynchronous client returns.
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
        """Plug-in that prepares every worker, also later ones, and ends the worker's cell with it."""

        def setup(self, worker: Worker) -> None:
            if own_cores:
                _keep_to_core(int(worker.name))
            prepare_worker(folder)

        def teardown(self, worker: object) -> None:
            del worker
            close_cell()

    return Cell()


def _keep_to_core(number: int) -> None:
    """Pin this process and its children to one core: without it a cell's threads lose a fifth by migration."""
    if sys.platform == "linux":
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[number % len(allowed)]})


AHEAD = 2
"""Number of submitted tasks per worker: one that runs, and one that follows without delay."""

RETRIES = 1
"""Number of retries of a campaign whose worker died; a second death is attributed to the campaign."""


class PointRunner:
    """Runner of points on the workers of a client, which is opened when the first point must run."""

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
        """Yield every point with its outcome: first the ended ones, then the others as they end.

        If `at_most` is given, only the first `at_most` of the others are run.
        """
        waiting: deque[Point] = deque()
        twins: dict[str, list[Point]] = {}
        for point in points:
            ended = self._ended(point)
            if ended is not None:
                yield point, ended
            elif point.id in twins:
                # Other settings can give the same campaign, e.g. if a schedule makes a gain equal: run it once.
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
            # `pure=False` gives a unique key: a retried point is a new task.
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
