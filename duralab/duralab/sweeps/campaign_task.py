"""What a worker does for one point: a cell, a campaign in it, its outcome on disk."""

from __future__ import annotations

import atexit
import os
import shutil
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from duralab.campaign import parse_campaign
from duralab.errors import InputError, LabError
from duralab.sweeps.cell import KeptCell
from duralab.sweeps.outcome import Costs, Outcome, State, outcome_of, write_outcome
from duralab.sweeps.points import Point
from duralab.sweeps.sweep_file import CellKind, Kept
from duralab_bus import configure_logs, log_stacks_on_signal

CAMPAIGN: Final = "campaign.yaml"
"""Of a point, in its folder: `duralab run` runs it again."""

_KEPT: Final[dict[str, KeptCell]] = {}
"""The cell of this worker process; Dask calls tasks and has no place for what they share."""


@dataclass(frozen=True)
class Task:
    """A point on its way to a worker.

    `point`: The campaign. `folder`: Of the point, as the worker sees it. `cell`: What it runs in. `keep`: What is kept
    of it.
    """

    point: Point
    folder: Path
    cell: CellKind
    keep: Kept


def run_point(task: Task) -> Outcome:
    """Run the campaign of a point and return what became of it; a campaign that fails is an outcome too."""
    point, folder = task.point, task.folder
    begun, processor = time.perf_counter(), time.process_time()
    opened = begun

    def costs() -> Costs:
        now = time.perf_counter()
        return Costs(cell=opened - begun, campaign=now - opened, processor=time.process_time() - processor)

    worker = f"{os.uname().nodename}:{os.getpid()}"
    folder.mkdir(parents=True, exist_ok=True)
    for specimen in point.specimens:
        specimen.write(folder / "specimens")
    (folder / CAMPAIGN).write_text(point.campaign, encoding="utf-8")
    try:
        plan = parse_campaign(point.campaign, name=f"point {point.id}")
        lab = _cell().lab(task.cell, rigs=point.rigs, specimens=point.specimens)
        opened = time.perf_counter()
        # What is not kept goes no further than the worker's own disk.
        place = folder if task.keep is Kept.RECORDINGS else lab.out / point.id
        result = lab.run(plan, out=place)
        outcome = outcome_of(
            point.id,
            result,
            rig_hash=lab.describe(plan.rig).content_hash,
            worker=worker,
            costs=costs(),
            bytes=sum(path.stat().st_size for path in folder.glob("recording*.mcap")),
        )
        if place != folder:
            shutil.rmtree(place)
    except LabError as error:
        if not isinstance(error, InputError):
            # The next campaign gets a cell of its own: what broke this one may still be in it.
            _cell().close()
        outcome = Outcome(point.id, State.FAILED, error.message, worker=worker, costs=costs())
    write_outcome(outcome, folder)
    return outcome


def _cell() -> KeptCell:
    if not _KEPT:
        from distributed import get_worker

        # Dask removes this folder after a worker that was killed, too.
        _KEPT[""] = KeptCell(Path(get_worker().local_directory))
        atexit.register(close_cell)
    return _KEPT[""]


def close_cell() -> None:
    """End the cell of this worker."""
    for cell in _KEPT.values():
        cell.close()


def prepare_worker(folder: Path) -> None:
    """Make a worker ready: its log, and a proof that it sees the sweep's folder."""
    logs = folder / "logs"
    try:
        logs.mkdir(parents=True, exist_ok=True)
        stream = (logs / f"worker-{os.uname().nodename}-{os.getpid()}.log").open("a", encoding="utf-8")
    except OSError as error:
        raise LabError(
            f"The worker {os.uname().nodename}:{os.getpid()} cannot write in {folder}: {error.strerror}; give a folder "
            "(--out) that all workers share."
        ) from error
    configure_logs("cell", stream=stream)
    # Where Dask keeps its workers as threads of another process, that one is not ours to change.
    if threading.current_thread() is threading.main_thread():
        log_stacks_on_signal()
