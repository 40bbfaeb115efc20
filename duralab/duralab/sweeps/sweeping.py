"""Running of a sweep: all points of its axes, or a search that can be resumed."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from duralab.arguments import progress_callback
from duralab.errors import InputError
from duralab.sweeps.cluster import POINTS, PointRunner, check_address, cores, open_workers
from duralab.sweeps.points import Point, PointMaker, grid, grid_size
from duralab.sweeps.results import Outcome, State, SweepResults, read_outcome, write_results
from duralab.sweeps.sweep_file import Search, Searched, SearchedChoice, Settings, Sweep, load_sweep

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial


JOURNAL: Final = "search.journal"
"""Name of Optuna's storage in the sweep's folder."""


def search(sweep: Sweep, maker: PointMaker, runner: PointRunner, *, folder: Path) -> Generator[tuple[Point, Outcome]]:
    """Search for the settings with the smallest error; yield every point as it ends.

    A fixed number of settings is tried together, independent of the number of workers, and each choice is seeded only
    by its number. So the search is the same on one worker and on a hundred, with or without an interruption.
    """
    plan = sweep.search
    if plan is None:
        raise ValueError("The sweep has no section search.")
    # Compute the size first: it refuses a grid that would fill the memory.
    trials = plan.budget // grid_size(sweep)
    beside = list(grid(sweep))
    if trials < 1:
        raise InputError(
            f"search.budget is {plan.budget} campaigns and one trial takes {len(beside)}, one for each point of the "
            f"axes; give {len(beside)} or more.",
            field="search.budget",
        )
    spaces = {key: _distribution(given) for key, given in plan.settings.items()}
    # Make the corners of the space now, to refuse bounds that are not allowed before anything is run.
    corners = [maker.make({**beside[0], **corner}) for corner in _corners(plan.settings)]
    # Other bounds, another campaign or other versions give another study.
    content = json.dumps([plan.model_dump_json(), *(point.id for point in corners)])
    study = _open_study(folder / JOURNAL, name=f"{sweep.name}-{hashlib.sha256(content.encode()).hexdigest()[:16]}")
    for start in range(0, trials, plan.together):
        numbers = range(start, min(start + plan.together, trials))
        trials_now = [_trial(study, plan, spaces, number) for number in numbers]
        points = {
            # A process that ended while it chose settings leaves a trial without settings.
            trial.number: [maker.make({**settings, **trial.params}) for settings in beside] if trial.params else []
            for trial in trials_now
        }
        figures: dict[str, float | None] = {}
        for point, outcome in runner.run([point for own in points.values() for point in own]):
            figures[point.id] = outcome.objective(plan.minimise)
            yield point, outcome
        _record_values(
            study, trials_now, {number: [figures[point.id] for point in own] for number, own in points.items()}
        )


def _record_values(study: Study, trials: Sequence[FrozenTrial], figures: Mapping[int, Sequence[float | None]]) -> None:
    """Report the values of trials to the study in order of their numbers, regardless of the order of their ends."""
    from optuna.trial import TrialState

    for trial in trials:
        if trial.state.is_finished():
            continue
        found = figures[trial.number]
        reached = [figure for figure in found if figure is not None]
        if reached and len(reached) == len(found):
            study.tell(trial.number, float(np.mean(reached)))
        else:
            study.tell(trial.number, state=TrialState.FAIL)


def _trial(study: Study, plan: Search, spaces: dict[str, BaseDistribution], number: int) -> FrozenTrial:
    """Return a trial of the study; choose a new one from the values reported so far if it does not exist."""
    from optuna.samplers import TPESampler

    if number >= len(study.get_trials(deepcopy=False)):
        # A seed for each number, so that a choice does not depend on earlier choices in this process.
        seed = int(np.random.SeedSequence([plan.seed, number]).generate_state(1)[0])
        study.sampler = TPESampler(seed=seed, n_startup_trials=plan.startup)
        study.ask(spaces)
    return study.get_trials(deepcopy=False)[number]


def _open_study(path: Path, *, name: str) -> Study:
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = JournalStorage(JournalFileBackend(str(path)))
    return optuna.create_study(storage=storage, study_name=name, load_if_exists=True)


def _distribution(given: Searched) -> BaseDistribution:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if isinstance(given, SearchedChoice):
        return CategoricalDistribution(given.choices)
    if given.whole:
        return IntDistribution(int(given.lowest), int(given.highest), log=given.logarithmic)
    return FloatDistribution(given.lowest, given.highest, log=given.logarithmic)


def _corners(settings: Mapping[str, Searched]) -> list[Settings]:
    """Return settings that contain every bound and every choice at least once."""
    ends = {
        key: given.choices
        if isinstance(given, SearchedChoice)
        else tuple(int(bound) if given.whole else bound for bound in (given.lowest, given.highest))
        for key, given in settings.items()
    }
    longest = max(len(values) for values in ends.values())
    return [{key: values[min(row, len(values) - 1)] for key, values in ends.items()} for row in range(longest)]


_WRITE_SECONDS: Final = 5.0
_WRITE_SHARE: Final = 0.01
"""Largest share of the time for writing intermediate results."""


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep: numbers of ended and failed points, and the smallest figure with its settings."""

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
    at_most: int | None = None,
    on_progress: OnProgress | None = None,
) -> SweepResults:
    """Run or continue a sweep; points that have ended in `out` with the same settings and versions are not run again.

    `out`: Folder that every worker can access; out/sweeps/<name> if not given. `workers`: Number of processes on this
    machine; one for each core if not given. `scheduler`: Address of a Dask scheduler whose workers are used instead.
    `at_most`: Maximum number of campaigns to run now, of those that have not ended; all if not given. `on_progress`:
    Called after every point, on this thread. A failed campaign gives a row with its error sentence.
    """
    check_address(scheduler, workers=workers)
    plan = sweep if isinstance(sweep, Sweep) else load_sweep(sweep)
    folder = Path(out) if out is not None else default_folder(plan)
    if at_most is not None and plan.search is not None:
        raise InputError(
            f"at_most is {at_most}, and sweep {plan.name!r} is a search, whose number of campaigns is search.budget; "
            "leave it out.",
            field="at_most",
        )
    total = plan.search.budget if plan.search is not None else grid_size(plan)
    maker = PointMaker(plan)
    # Make all points before the first is run, to refuse values that are not allowed.
    points = [] if plan.search is not None else sorted(map(maker.make, grid(plan)), key=lambda point: repr(point.cell))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sweep.yaml").write_text(plan.text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be made: {error.strerror}; give another.") from error
    with ExitStack() as stack:
        open_client = lambda: stack.enter_context(open_workers(folder, workers=workers, scheduler=scheduler))  # noqa: E731
        runner = PointRunner(open_client, plan, folder=folder, retry_failed=retry_failed, at_most=at_most)
        ended = search(plan, maker, runner, folder=folder) if plan.search is not None else runner.run(points)
        return _Book(plan, folder, total=total, on_progress=progress_callback(on_progress)).keep(ended)


def default_folder(sweep: Sweep) -> Path:
    """Return the default folder of a sweep."""
    return Path("out") / "sweeps" / sweep.name


class _Book:
    """Collector of ended points; writes results periodically and reports progress."""

    def __init__(self, sweep: Sweep, folder: Path, *, total: int, on_progress: OnProgress) -> None:
        self._sweep, self._folder, self._total, self._on_progress = sweep, folder, total, on_progress
        self._rows: list[tuple[Mapping[str, Any], Outcome]] = []
        self._failed = 0
        self._best: tuple[float, Mapping[str, Any]] | None = None
        self._next_write = 0.0

    def keep(self, ended: Generator[tuple[Point, Outcome]]) -> SweepResults:
        self._progress()
        try:
            with closing(ended):
                for point, outcome in ended:
                    self._take(point.settings, outcome)
                    self._progress()
                    if time.monotonic() >= self._next_write:
                        self._write()
        finally:
            # Write the results of an interrupted sweep too, for its report.
            results = self._write()
        return results

    def _write(self) -> SweepResults:
        begun = time.monotonic()
        # Sort the rows, so that they do not depend on the speed of the workers.
        rows = sorted(self._rows, key=lambda row: (repr(sorted(row[0].items(), key=str)), row[1].id))
        results = write_results(self._folder, self._sweep, rows, total=self._total)
        ended = time.monotonic()
        self._next_write = ended + max(_WRITE_SECONDS, (ended - begun) / _WRITE_SHARE)
        return results

    def _take(self, settings: Mapping[str, Any], outcome: Outcome) -> None:
        self._rows.append((settings, outcome))
        self._failed += outcome.state is State.FAILED
        figure = outcome.objective(self._sweep.compare_by)
        if figure is not None and (self._best is None or figure < self._best[0]):
            self._best = (figure, settings)

    def _progress(self) -> None:
        best, settings = self._best or (None, {})
        self._on_progress(SweepProgress(len(self._rows), self._total, self._failed, best, settings))


@dataclass(frozen=True)
class SweepForecast:
    """Forecast of a sweep from its ended campaigns.

    `total`, `ended`, `failed`: Numbers of campaigns. `seconds_each`: Time of a campaign on a worker, with its share of
    opening cells. `bytes_each`: Kept bytes of a campaign. Both are None if none has finished. `seconds_left`,
    `bytes_left`: Totals of the remaining campaigns on `workers`. `free_bytes`: Free bytes on the disk of the folder.
    """

    total: int
    ended: int
    failed: int
    workers: int
    seconds_each: float | None
    bytes_each: float | None
    free_bytes: int

    @property
    def seconds_left(self) -> float | None:
        """Time until the last campaign has ended, in s."""
        return None if self.seconds_each is None else (self.total - self.ended) * self.seconds_each / self.workers

    @property
    def bytes_left(self) -> float | None:
        """Number of bytes that the remaining campaigns will keep."""
        return None if self.bytes_each is None else (self.total - self.ended) * self.bytes_each


def forecast_sweep(
    sweep: Sweep | str | Path, *, out: str | Path | None = None, workers: int | None = None
) -> SweepForecast:
    """Forecast time and disk space of a sweep; nothing is run.

    All points are made, so that values that are not allowed are found. `out`, `workers`: As for `run_sweep`.
    """
    plan = sweep if isinstance(sweep, Sweep) else load_sweep(sweep)
    folder = Path(out) if out is not None else default_folder(plan)
    if plan.search is not None:
        raise InputError(
            f"Sweep {plan.name!r} is a search, which chooses its points as it runs; a forecast is made for a grid, so "
            "leave it out.",
            field="search",
        )
    maker = PointMaker(plan)
    ids = {point.id for point in map(maker.make, grid(plan))}
    ended = [outcome for id in ids if (outcome := read_outcome(folder / POINTS / id)) is not None]
    finished = [outcome for outcome in ended if outcome.state is State.FINISHED]
    existing = next(place for place in (folder.resolve(), *folder.resolve().parents) if place.is_dir())
    return SweepForecast(
        total=len(ids),
        ended=len(ended),
        failed=len(ended) - len(finished),
        workers=workers or cores(),
        seconds_each=_mean([outcome.costs.cell + outcome.costs.campaign for outcome in finished]),
        bytes_each=_mean([float(outcome.bytes) for outcome in finished]),
        free_bytes=shutil.disk_usage(existing).free,
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
