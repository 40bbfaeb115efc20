"""A lab as a script meets it: its rigs, playing them, running campaigns."""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from duralab._asking import Asking
from duralab._campaigns import OnProgress, collect, followed, free_id, stop_campaign
from duralab._drive_signals import drive_signals
from duralab._following import RunProgress, Stage, progress_of
from duralab._resuming import resume_campaign
from duralab._specification import build_specification, check_against_rig
from duralab._supervisor import Supervisor
from duralab._target import describe_target, make_target
from duralab.campaign_file import Campaign
from duralab.campaign_loading import load_campaign
from duralab.campaign_result import CampaignResult
from duralab.catalogue import Catalogue
from duralab.errors import InputError, LabError
from duralab.identification import Identifier
from duralab.played import Played
from duralab.recording_content import actuator_use
from duralab.rig import Rig
from duralab.signals import Signals
from duralab_proto.v1 import iterator_pb2, query_pb2, rig_pb2
from labbus import Bus, FaultError

if TYPE_CHECKING:
    import xarray


class Lab:
    """A lab on the bus; made by `start` and `connect`.

    Parameters
    ----------
    bus : Bus
        The session.
    out : Path
        Folder for what campaigns leave behind.
    supervisor : Supervisor, optional
        Of the services, where this process started them.
    """

    def __init__(self, bus: Bus, *, out: Path, supervisor: Supervisor | None = None) -> None:
        self.out = out
        self._bus = bus
        self._supervisor = supervisor
        self._ask = Asking(bus, self.failure)

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Where others may connect to this lab."""
        return self._bus.listening

    def failure(self) -> LabError | None:
        """Return what happened to a service of this lab that ended by itself; None while all is well."""
        return self._supervisor.failure() if self._supervisor is not None else None

    @property
    def process_ids(self) -> dict[str, int]:
        """Process id of each service that this process started."""
        return self._supervisor.process_ids if self._supervisor is not None else {}

    def rig_names(self) -> list[str]:
        """Return the names of all rigs that are there; one that cannot be used says why when it is asked."""
        return sorted(instance for _, instance in self._bus.live("rig_sim"))

    @property
    def identifier(self) -> Identifier:
        """Identifies rigs without a campaign around it."""
        return Identifier(query=self._ask.query, describe=self.describe, keys=self._bus.keys)

    @property
    def catalogue(self) -> Catalogue:
        """Finds and checks the recordings that the lab's recorder holds."""
        return Catalogue(self._ask)

    def rigs(self) -> list[Rig]:
        """Return all rigs that are there, by name; raises `LabError` where one of them cannot be used."""
        return [self.describe(name) for name in self.rig_names()]

    def describe(self, rig: str) -> Rig:
        """Return what a rig is and what it can play.

        Raises
        ------
        InputError
            There is no such rig.
        """
        key = self._ask.key("rig", self._bus.keys.rig_description, rig)
        known = self.rig_names()
        if rig not in known and self.failure() is None:
            there = (
                f"there are {', '.join(known)}"
                if known
                else "no rig is on the bus, or not yet: see whether rig_sim runs"
            )
            raise InputError(f"There is no rig {rig!r}; {there}.", field="rig")
        return Rig.from_message(self._ask.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription))

    def play(
        self,
        rig: str,
        drive: np.ndarray | xarray.DataArray | Signals,
        *,
        run: str | None = None,
        seed: int = 0,
        real_time: bool = False,
        on_progress: OnProgress | None = None,
    ) -> Played:
        """Play a drive on a rig and wait for its response.

        Parameters
        ----------
        rig : str
            Its name.
        drive : array or Signals, shape (drives, samples)
            In the units, the order and at the sample rate of the rig's description.
        run : str, optional
            Name of the playback, unique on the rig; a new one where not given.
        seed : int
            Of what is random in a simulated rig.
        real_time : bool
            Play no faster than real time.
        on_progress : callable, optional
            Called with a `RunProgress` about once a second.

        Raises
        ------
        LabError
            The rig refused the drive (`InputError`), stopped, or is gone.
        """
        description = self.describe(rig)
        signals = drive_signals(drive, description)
        name = run or f"script-{uuid.uuid4().hex[:12]}"
        request = rig_pb2.PlayRequest(run=name, drive=signals.to_message(), seed=seed, real_time=real_time)

        def report(progress: query_pb2.Progress) -> None:
            if on_progress is not None:
                on_progress(
                    RunProgress(
                        stage=Stage.TARGET,
                        activity=progress.phase,
                        fraction=progress.fraction,
                        remaining_seconds=progress.remaining_seconds,
                    )
                )

        key = self._ask.key("rig", self._bus.keys.rig_play, rig)
        result = self._ask.query(key, request, rig_pb2.PlayResult, on_progress=report)
        return Played(
            run=result.run,
            response=Signals.from_message(result.response, field="response"),
            actuators=actuator_use(result.actuators),
            real_time_factor=result.real_time_factor,
        )

    def run(
        self,
        campaign: Campaign | str | Path,
        *,
        out: str | Path | None = None,
        on_progress: OnProgress | None = None,
    ) -> CampaignResult:
        """Run a campaign to its end: make the target, identify the rig, iterate the drive, fetch the recording.

        Parameters
        ----------
        campaign : Campaign, str or Path
            A campaign, its file, or the name of one that comes with the package.
        out : str or Path, optional
            Folder for `recording.mcap` and `live.rrd`; `<lab.out>/<name of the campaign>` where not given.
        on_progress : callable, optional
            Called with every `RunProgress`, on this thread.

        Returns
        -------
        CampaignResult

        Raises
        ------
        InputError
            The campaign does not fit the rig, or a service refused a value.
        CampaignFaultError
            The campaign ended before its last playback.
        LabError
            A service is not there or ended.
        """
        plan = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
        tell = on_progress or _tell_nobody
        id = free_id(self._ask, plan.name)
        tell(RunProgress(Stage.TARGET, "asking the rigs", 0.0, -1.0))
        rig = self.describe(plan.rig)
        check_against_rig(plan, rig)
        vehicle = self.describe(plan.target.vehicle) if plan.target.vehicle is not None else None
        driven: list[Signals] = []

        def drive_road(inputs: Signals) -> Signals:
            driven.append(inputs)
            return self._drive_road(plan, id, inputs, tell)

        target = make_target(plan, rig=rig, vehicle=vehicle, play=drive_road)
        tell(RunProgress(Stage.TARGET, "target made", 1.0, 0.0))
        specification = build_specification(plan, id=id, rig=rig, target=target, source=describe_target(plan.target))
        for inputs in driven:
            # With these the target can be made again, sample by sample.
            specification.target_drive.CopyFrom(inputs.to_message())
            specification.target_rig, specification.target_seed = plan.target.vehicle or "", plan.seed

        def begin() -> iterator_pb2.CampaignStatus:
            return self._bus.query(self._bus.keys.campaign_start(), specification, iterator_pb2.CampaignStatus)

        status = followed(self._ask, id, begin=begin, tell=tell)
        return collect(self._ask, specification, status, folder=Path(out) if out is not None else self.out / id)

    def resume(
        self,
        id: str,
        *,
        settings: Campaign | str | Path | None = None,
        from_iteration: int = 0,
        out: str | Path | None = None,
        replace: bool = True,
        on_progress: OnProgress | None = None,
    ) -> CampaignResult:
        """Go on with a campaign that a crash broke off, or take up an ended one again; nothing committed is replayed.

        An ended campaign, one whose recorder ended too, and other settings make a new campaign that names its parent.

        Parameters
        ----------
        id : str
            The campaign, by the name of its recording.
        settings : Campaign, str or Path, optional
            A campaign file whose sections `update` and `stop` take the place of the campaign's own.
        from_iteration : int
            The last playback to build on, from 1; 0 is the last there is.
        out, on_progress
            As for `run`.
        replace : bool
            False refuses to go on where an output would take the place of an existing file.

        Raises
        ------
        InputError, CampaignFaultError, LabError
            As `run` does.
        """
        plan = settings if settings is None or isinstance(settings, Campaign) else load_campaign(settings)
        return resume_campaign(
            self._ask,
            id,
            settings=plan,
            from_iteration=from_iteration,
            describe=self.describe,
            folder=lambda name: Path(out) if out is not None else self.out / name,
            replace=replace,
            tell=on_progress or _tell_nobody,
        )

    def stop(self, id: str, *, reason: str = "") -> RunProgress:
        """Stop a campaign and its playback, and return how far it got; one that has ended stays as it is.

        Parameters
        ----------
        id : str
            The campaign.
        reason : str
            In words; kept in the recording.

        Raises
        ------
        InputError
            No such campaign was started or resumed since the iterator began.
        """
        try:
            return progress_of(stop_campaign(self._ask, id, reason=reason))
        except FaultError as fault:
            raise self._ask.explained(fault) from fault

    def _drive_road(self, plan: Campaign, id: str, inputs: Signals, tell: OnProgress) -> Signals:
        vehicle = plan.target.vehicle or ""
        tell(RunProgress(Stage.TARGET, f"driving {vehicle} over the road", 0.0, -1.0))
        run = f"{id}.target-{uuid.uuid4().hex[:8]}"
        return self.play(vehicle, inputs, run=run, seed=plan.seed, on_progress=tell).response


def _tell_nobody(progress: RunProgress) -> None:
    del progress
