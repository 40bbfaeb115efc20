"""Task of one point of a sweep: start a cell, run a campaign in it, write its outcome to disk."""

from __future__ import annotations

import atexit
import logging
import os
import platform
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from duralab.campaign import parse_campaign
from duralab.errors import InputError, LabError
from duralab.lab import Lab, RecordingsPlace
from duralab.processes import ServicePlan, Supervisor, lab_services
from duralab.sweeps.points import Point
from duralab.sweeps.results import Costs, Outcome, State, outcome_of, write_outcome
from duralab.sweeps.specimens import SpecimenText
from duralab.sweeps.sweep_file import CellKind, Kept
from duralab_bus import (
    BusConfig,
    BusError,
    ConfigError,
    FaultError,
    configure_logs,
    host_services,
    keep_few_arenas,
    log_stacks_on_signal,
    open_bus,
)

HOSTED_WORKERS: Final = 16
"""Number of threads that answer queries on a bus shared by four services: the sum of their separate numbers."""

LIVE_SECONDS: Final = 30.0
"""Longest time until started services find each other."""

KEPT_BYTES: Final = 128 * 2**20
"""Freed memory in bytes that a worker keeps for the next campaign."""

LARGEST_CELL_BYTES: Final = 2 * 2**30
"""Size of the recordings in a cell, fetched or not, above which the cell is replaced."""


@contextmanager
def open_cell(kind: CellKind, *, rigs: Sequence[str], specimens: Sequence[SpecimenText], folder: Path) -> Iterator[Lab]:
    """Start a lab for one campaign at a time until the block ends."""
    # The whole folder is deleted with the cell, also recordings of failed campaigns that were not fetched.
    place = RecordingsPlace(passing=folder)
    paths = {specimen.rig: specimen.write(folder / "specimens") for specimen in specimens}
    plans = lab_services(rigs=rigs, recordings=folder / "recordings", viewer=None, specimens=paths, live_file=False)
    with ExitStack() as stack:
        try:
            # By default the bus is a peer that listens on a free port of loopback.
            bus = stack.enter_context(open_bus(BusConfig(), service="cell", workers=HOSTED_WORKERS))
            if kind is CellKind.LAB:
                supervisor = stack.enter_context(Supervisor(plans, bus=bus, logs=folder / "logs"))
                supervisor.start()
                yield Lab(bus, out=folder / "out", supervisor=supervisor, recordings=place)
                return
            stack.enter_context(host_services(bus, _hosted(plans)))
            # Declarations take some time to become visible, also within one process.
            instances = {(plan.name, instance) for plan in plans for instance in plan.instances}
            bus.wait_for_live(instances, LIVE_SECONDS)
        except (BusError, ConfigError, FaultError) as error:
            raise LabError(str(error)) from error
        yield Lab(bus, out=folder / "out", recordings=place)


def _hosted(plans: Sequence[ServicePlan]) -> dict[str, dict[str, object]]:
    """Return the settings of services in one process; the recorder starts first, so that it ends last."""
    settings = {plan.name: dict(plan.settings) for plan in reversed(plans)}
    # No spool is needed, because the recorder ends with the process; no wear folder, because specimens are new.
    for folder in ("spool_folder", "wear_folder"):
        settings["rig_sim"].pop(folder, None)
    return settings


class KeptCell:
    """Cell of a worker, kept for the next campaign if that needs the same rigs."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._key: object = None
        self._stack = ExitStack()
        self._lab: Lab | None = None
        self._place = Path()

    def lab(self, kind: CellKind, *, rigs: tuple[str, ...], specimens: tuple[SpecimenText, ...]) -> Lab:
        """Return a lab with these rigs: the existing one, or a new one that replaces it."""
        key = (kind, rigs, specimens)
        usable = self._lab is not None and self._key == key and self._lab.failure() is None
        if usable and self._lab is not None and _bytes_in(self._place) < LARGEST_CELL_BYTES:
            return self._lab
        self.close()
        self._place = Path(tempfile.mkdtemp(prefix="duralab-cell-", dir=self._folder))
        self._stack.callback(shutil.rmtree, self._place, ignore_errors=True)
        try:
            self._lab = self._stack.enter_context(open_cell(kind, rigs=rigs, specimens=specimens, folder=self._place))
        except BaseException:
            self.close()
            raise
        self._key = key
        return self._lab

    def close(self) -> None:
        """End the existing lab, if any."""
        self._lab, self._key = None, None
        try:
            self._stack.close()
        except RuntimeError:
            # Zenoh's binding refuses to undeclare an object that its thread is using at this moment. The rest of
            # the session stays in this process and has no connections.
            logging.getLogger("cell").warning("The cell was not closed in order.", exc_info=True)


def _bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in (folder / "recordings").glob("*") if path.is_file())


CAMPAIGN: Final = "campaign.yaml"
"""Name of a point's campaign file in its folder; `duralab run` can run it again."""

_KEPT: Final[dict[str, KeptCell]] = {}
"""Cell of this worker process; module state, because Dask tasks share no other state."""


@dataclass(frozen=True)
class Task:
    """Task of a worker for a point, with the folder's path on the worker."""

    point: Point
    folder: Path
    cell: CellKind
    keep: Kept


def run_point(task: Task) -> Outcome:
    """Run the campaign of a point and return its outcome, also if the campaign fails."""
    point, folder = task.point, task.folder
    begun, processor = time.perf_counter(), time.process_time()
    opened = begun

    def costs() -> Costs:
        now = time.perf_counter()
        return Costs(cell=opened - begun, campaign=now - opened, processor=time.process_time() - processor)

    worker = f"{platform.node()}:{os.getpid()}"
    folder.mkdir(parents=True, exist_ok=True)
    for specimen in point.specimens:
        specimen.write(folder / "specimens")
    (folder / CAMPAIGN).write_text(point.campaign, encoding="utf-8")
    try:
        plan = parse_campaign(point.campaign, name=f"point {point.id}")
        lab = _cell().lab(task.cell, rigs=point.rigs, specimens=point.specimens)
        opened = time.perf_counter()
        # Recordings that are not kept stay on the worker's local disk.
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
            # The next campaign gets a new cell: the cause of this error may persist in the cell.
            _cell().close()
        outcome = Outcome(point.id, State.FAILED, error.message, worker=worker, costs=costs())
    write_outcome(outcome, folder)
    return outcome


def _cell() -> KeptCell:
    if not _KEPT:
        from distributed import get_worker

        # Dask removes this folder also after a killed worker.
        _KEPT[""] = KeptCell(Path(get_worker().local_directory))
        atexit.register(close_cell)
    return _KEPT[""]


def close_cell() -> None:
    """End the cell of this worker."""
    for cell in _KEPT.values():
        cell.close()


def prepare_worker(folder: Path) -> None:
    """Prepare a worker: open its log, and check that it can write to the sweep's folder."""
    logs = folder / "logs"
    try:
        logs.mkdir(parents=True, exist_ok=True)
        stream = (logs / f"worker-{platform.node()}-{os.getpid()}.log").open("a", encoding="utf-8")
    except OSError as error:
        raise LabError(
            f"The worker {platform.node()}:{os.getpid()} cannot write in {folder}: {error.strerror}; give a folder "
            "(--out) that all workers share."
        ) from error
    configure_logs("cell", stream=stream)
    keep_few_arenas(2, kept_bytes=KEPT_BYTES)
    # If Dask runs its workers as threads of another process, do not change that process.
    if threading.current_thread() is threading.main_thread():
        log_stacks_on_signal()
