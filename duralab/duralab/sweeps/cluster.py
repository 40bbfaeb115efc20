"""The workers of a sweep: processes on this machine, or those of a Dask scheduler elsewhere."""

from __future__ import annotations

import logging
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from duralab.errors import InputError, LabError
from duralab.sweeps.campaign_task import close_cell, prepare_worker
from duralab.sweeps.identity import installed_versions

if TYPE_CHECKING:
    from distributed import Client, Worker

_SCHEDULER: Final = re.compile(r"(tcp|tls)://[A-Za-z0-9._\-\[\]:]+:\d{1,5}")
CONNECT_SECONDS: Final = 15
WORKER_SECONDS: Final = 60


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[number % len(allowed)]})
