"""A sweep from its file to its results."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from duralab.errors import InputError
from duralab.sweeps.cluster import check_address, open_workers
from duralab.sweeps.outcome import Outcome, State
from duralab.sweeps.point_running import PointRunner
from duralab.sweeps.points import Point, PointMaker, grid, grid_size
from duralab.sweeps.results import SweepResults, write_results
from duralab.sweeps.search import search
from duralab.sweeps.sweep_file import Sweep
from duralab.sweeps.sweep_loading import load_sweep

_WRITE_SECONDS: Final = 5.0
_WRITE_SHARE: Final = 0.05
"""Results are written now and then, and in no more than this share of the time."""


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is.

    `ended`, `total`: Points. `failed`: How many of those that ended failed. `best`: Smallest figure so far.
    `best_settings`: Of that point.
    """

    ended: int
    total: int
    failed: int
    best: float | None
    best_settings: Mapping[str, Any]


OnProgress = Callable[[SweepProgress], None]


def run_sweep(
    sweep: Sweep | str | Path,
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    on_progress: OnProgress | None = None,
) -> SweepResults:
    """Run a sweep, or go on with one; points whose settings and versions have ended in `out` are not run again.

    `sweep`: A sweep, its file, or the name of one that comes with the package. `out`: Its folder, seen by every worker;
    out/sweeps/<name> where not given. `workers`: Processes on this machine; one for each core where not given.
    `scheduler`: Address of a Dask scheduler whose workers are used instead. `retry_failed`: Whether points that failed
    before are run again. `on_progress`: Called with a `SweepProgress` after every point, on this thread.
    Returns: A campaign that fails is a row with its sentence.
    Raises `InputError`: A key or a value is not allowed; nothing has been run then. `LabError`: There are no workers.
    """
    check_address(scheduler, workers=workers)
    plan = sweep if isinstance(sweep, Sweep) else load_sweep(sweep)
    folder = Path(out) if out is not None else default_folder(plan)
    total = plan.search.budget if plan.search is not None else grid_size(plan)
    maker = PointMaker(plan)
    # All are made before the first is run: a value that is not allowed is found now.
    points = [] if plan.search is not None else sorted(map(maker.make, grid(plan)), key=lambda point: repr(point.cell))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sweep.yaml").write_text(plan.text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be made: {error.strerror}; give another.") from error
    with ExitStack() as stack:
        open_client = lambda: stack.enter_context(open_workers(folder, workers=workers, scheduler=scheduler))  # noqa: E731
        runner = PointRunner(open_client, plan, folder=folder, retry_failed=retry_failed)
        ended = search(plan, maker, runner, folder=folder) if plan.search is not None else runner.run(points)
        return _Book(plan, folder, total=total, tell=on_progress or _tell_nobody).keep(ended)


def default_folder(sweep: Sweep) -> Path:
    """Return where a sweep goes that is not told where.

    `sweep`: The sweep.
    Returns: The folder.
    """
    return Path("out") / "sweeps" / sweep.name


class _Book:
    """Keeps what has ended, writes it now and then, and tells how far the sweep is."""

    def __init__(self, sweep: Sweep, folder: Path, *, total: int, tell: OnProgress) -> None:
        self._sweep, self._folder, self._total, self._tell = sweep, folder, total, tell
        self._rows: list[tuple[Mapping[str, Any], Outcome]] = []
        self._next_write = 0.0

    def keep(self, ended: Generator[tuple[Point, Outcome]]) -> SweepResults:
        self._progress()
        try:
            with closing(ended):
                for point, outcome in ended:
                    self._rows.append((point.settings, outcome))
                    self._progress()
                    if time.monotonic() >= self._next_write:
                        self._write()
        finally:
            # An interrupted sweep has results too, and a report.
            results = self._write()
        return results

    def _write(self) -> SweepResults:
        begun = time.monotonic()
        # In an order of their own: which worker was quicker is no result.
        rows = sorted(self._rows, key=lambda row: (repr(sorted(row[0].items(), key=str)), row[1].id))
        results = write_results(self._folder, self._sweep, rows, total=self._total)
        ended = time.monotonic()
        self._next_write = ended + max(_WRITE_SECONDS, (ended - begun) / _WRITE_SHARE)
        return results

    def _progress(self) -> None:
        figures = [(outcome.objective(self._sweep.compare_by), settings) for settings, outcome in self._rows]
        found = [(figure, settings) for figure, settings in figures if figure is not None]
        best, settings = min(found, key=lambda pair: pair[0], default=(None, {}))
        failed = sum(outcome.state is State.FAILED for _, outcome in self._rows)
        self._tell(SweepProgress(len(self._rows), self._total, failed, best, settings))


def _tell_nobody(progress: SweepProgress) -> None:
    del progress
