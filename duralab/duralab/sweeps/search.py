"""Searching for settings: a tree-structured Parzen estimator (Bergstra et al. 2011), by Optuna, that can be resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.errors import InputError
from duralab.sweeps.outcome import Outcome
from duralab.sweeps.point_running import PointRunner
from duralab.sweeps.points import Point, PointMaker, grid, grid_size
from duralab.sweeps.sweep_file import Search, Searched, SearchedChoice, Settings, Sweep

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial

JOURNAL: Final = "search.journal"
"""Optuna's storage, in the sweep's folder."""


def search(sweep: Sweep, maker: PointMaker, runner: PointRunner, *, folder: Path) -> Generator[tuple[Point, Outcome]]:
    """Search for the settings with the smallest figure; yields every point as it ends.

    Some settings are tried together, whatever the number of workers, and each choice is seeded by its number alone: the
    search takes the same way on one worker and on a hundred, at once or after a break.
    """
    plan = sweep.search
    if plan is None:
        raise ValueError("The sweep has no section search.")
    # The size first: it refuses a grid that would fill the memory.
    trials = plan.budget // grid_size(sweep)
    beside = list(grid(sweep))
    if trials < 1:
        raise InputError(
            f"search.budget is {plan.budget} campaigns and one trial takes {len(beside)}, one for each point of the "
            f"axes; give {len(beside)} or more.",
            field="search.budget",
        )
    spaces = {key: _distribution(given) for key, given in plan.settings.items()}
    # The corners of the space are made now: a bound that is not allowed is found before anything is run.
    corners = [maker.make({**beside[0], **corner}) for corner in _corners(plan.settings)]
    # Other bounds, another campaign or other versions: another study.
    content = json.dumps([plan.model_dump_json(), *(point.id for point in corners)])
    study = _open_study(folder / JOURNAL, name=f"{sweep.name}-{hashlib.sha256(content.encode()).hexdigest()[:16]}")
    for start in range(0, trials, plan.together):
        numbers = range(start, min(start + plan.together, trials))
        trials_now = [_trial(study, plan, spaces, number) for number in numbers]
        points = {
            # A process that ended in the middle of choosing leaves a trial without settings.
            trial.number: [maker.make({**settings, **trial.params}) for settings in beside] if trial.params else []
            for trial in trials_now
        }
        figures: dict[str, float | None] = {}
        for point, outcome in runner.run([point for own in points.values() for point in own]):
            figures[point.id] = outcome.objective(plan.minimise)
            yield point, outcome
        _tell(study, trials_now, {number: [figures[point.id] for point in own] for number, own in points.items()})


def _tell(study: Study, trials: Sequence[FrozenTrial], figures: Mapping[int, Sequence[float | None]]) -> None:
    """Tell the study what trials came to, in their order, so that it is the same whichever ended first."""
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
    """Return a trial of the study; one that it does not have yet is chosen by what was told until now."""
    from optuna.samplers import TPESampler

    if number >= len(study.get_trials(deepcopy=False)):
        # A seed for each number: a choice does not depend on how many were made since the process began.
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
    """Return settings in which every bound and every choice stands once at least."""
    ends = {
        key: given.choices
        if isinstance(given, SearchedChoice)
        else tuple(int(bound) if given.whole else bound for bound in (given.lowest, given.highest))
        for key, given in settings.items()
    }
    longest = max(len(values) for values in ends.values())
    return [{key: values[min(row, len(values) - 1)] for key, values in ends.items()} for row in range(longest)]
