"""A rig cell: the lab that one task owns while its campaign runs."""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from duralab.errors import LabError
from duralab.lab import Lab, RecordingsPlace
from duralab.processes import ServicePlan, Supervisor, lab_services
from duralab.sweeps.specimens import SpecimenText
from duralab.sweeps.sweep_file import CellKind
from duralab_bus import BusConfig, BusError, ConfigError, FaultError, host_services, open_bus

HOSTED_WORKERS: Final = 16
"""Threads that answer queries where four services share a bus: as many as they have by themselves."""

LIVE_SECONDS: Final = 30.0
"""Longest time until services that stand know of each other."""

LARGEST_CELL_BYTES: Final = 2 * 2**30
"""Of the recordings that a cell holds beside those that were fetched, before it is made anew."""


@contextmanager
def open_cell(kind: CellKind, *, rigs: Sequence[str], specimens: Sequence[SpecimenText], folder: Path) -> Iterator[Lab]:
    """Start a lab for one campaign at a time; it is ended with the block."""
    # The whole folder goes with the cell: what of a campaign that failed is not fetched is not kept.
    place = RecordingsPlace(passing=folder)
    paths = {specimen.rig: specimen.write(folder / "specimens") for specimen in specimens}
    plans = lab_services(rigs=rigs, recordings=folder / "recordings", viewer=None, specimens=paths, live_file=False)
    with ExitStack() as stack:
        try:
            # The default: a peer that listens on a free port of loopback.
            bus = stack.enter_context(open_bus(BusConfig(), service="cell", workers=HOSTED_WORKERS))
            if kind is CellKind.LAB:
                supervisor = stack.enter_context(Supervisor(plans, bus=bus, logs=folder / "logs"))
                supervisor.start()
                yield Lab(bus, out=folder / "out", supervisor=supervisor, recordings=place)
                return
            stack.enter_context(host_services(bus, _hosted(plans)))
            # What was declared is known a moment later, in the same process too.
            instances = {(plan.name, instance) for plan in plans for instance in plan.instances}
            bus.wait_for_live(instances, LIVE_SECONDS)
        except (BusError, ConfigError, FaultError) as error:
            raise LabError(str(error)) from error
        yield Lab(bus, out=folder / "out", recordings=place)


def _hosted(plans: Sequence[ServicePlan]) -> dict[str, dict[str, object]]:
    """Return the settings of services in one process, the recorder first, so that it goes last."""
    settings = {plan.name: dict(plan.settings) for plan in reversed(plans)}
    # What is not yet stored need not outlive a process whose recorder goes with it.
    settings["rig_sim"].pop("spool_folder", None)
    return settings


class KeptCell:
    """The cell of a worker: kept from one campaign to the next while they need the same rigs.

    `folder`: Where its folders are made; the system's temporary folder where not given.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._key: object = None
        self._stack = ExitStack()
        self._lab: Lab | None = None
        self._place = Path()

    def lab(self, kind: CellKind, *, rigs: tuple[str, ...], specimens: tuple[SpecimenText, ...]) -> Lab:
        """Return a lab with these rigs: the one that is there, or a new one in its place."""
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
        """End the lab that is there."""
        self._lab, self._key = None, None
        try:
            self._stack.close()
        except RuntimeError:
            # Zenoh's binding refuses to withdraw what a thread of its own has in its hands at this very moment. What
            # is left of the session is alone in this process and reaches nobody.
            logging.getLogger("cell").warning("The cell was not closed in order.", exc_info=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in (folder / "recordings").glob("*") if path.is_file())
