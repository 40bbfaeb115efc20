"""A lab as a script meets it: its rigs, playing them, running campaigns."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np
from google.protobuf.message import Message

from duralab._drive_signals import drive_signals
from duralab._fetching import fetch_result
from duralab._following import RunProgress, Stage, follow_campaign, progress_of
from duralab._specification import build_specification, check_against_rig
from duralab._supervisor import Supervisor
from duralab._target import describe_target, make_target
from duralab.campaign_file import Campaign
from duralab.campaign_loading import load_campaign
from duralab.campaign_result import CampaignResult
from duralab.errors import CampaignFaultError, InputError, LabError
from duralab.identification import Identifier
from duralab.recording_content import ActuatorUse, actuator_use
from duralab.rig import Rig
from duralab.signals import Signals
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from labbus import Bus, BusError, FaultError

if TYPE_CHECKING:
    import xarray

_INPUT_FAULTS: Final = frozenset(
    {
        query_pb2.FAULT_CODE_INVALID_ARGUMENT,
        query_pb2.FAULT_CODE_NOT_FOUND,
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
    }
)
_STOP_SILENCE_SECONDS: Final = 2.0

MessageT = TypeVar("MessageT", bound=Message)
OnProgress = Callable[[RunProgress], None]


@dataclass(frozen=True, eq=False)
class Played:
    """What a rig answered to a drive.

    Parameters
    ----------
    run : str
        Name of the playback.
    response : Signals
        All responses, as many samples as the drive.
    actuators : tuple of ActuatorUse
        How each actuator was used.
    real_time_factor : float
        Simulated seconds per second of wall time.
    """

    run: str
    response: Signals
    actuators: tuple[ActuatorUse, ...]
    real_time_factor: float


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
        return Identifier(query=self._query, describe=self.describe, keys=self._bus.keys)

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
        key = self._key("rig", self._bus.keys.rig_description, rig)
        known = self.rig_names()
        if rig not in known and self.failure() is None:
            there = (
                f"there are {', '.join(known)}"
                if known
                else "no rig is on the bus, or not yet: see whether rig_sim runs"
            )
            raise InputError(f"There is no rig {rig!r}; {there}.", field="rig")
        return Rig.from_message(self._query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription))

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

        key = self._key("rig", self._bus.keys.rig_play, rig)
        result = self._query(key, request, rig_pb2.PlayResult, on_progress=report)
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
        id = self._free_id(plan.name)
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
        status = self._campaign(specification, tell)
        return self._collect(specification, status, folder=Path(out) if out is not None else self.out / id)

    def _drive_road(self, plan: Campaign, id: str, inputs: Signals, tell: OnProgress) -> Signals:
        vehicle = plan.target.vehicle or ""
        tell(RunProgress(Stage.TARGET, f"driving {vehicle} over the road", 0.0, -1.0))
        run = f"{id}.target-{uuid.uuid4().hex[:8]}"
        return self.play(vehicle, inputs, run=run, seed=plan.seed, on_progress=tell).response

    def _free_id(self, name: str) -> str:
        """Return the campaign's name, with a number where the lab's recorder holds one of that name already."""
        taken = {
            information.recording
            for information in self._query(
                self._bus.keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList
            ).recordings
        }
        numbered = (name if number == 1 else f"{name}-{number}" for number in range(1, len(taken) + 2))
        return next(candidate for candidate in numbered if candidate not in taken)

    def _campaign(self, specification: iterator_pb2.CampaignSpec, tell: OnProgress) -> iterator_pb2.CampaignStatus:
        def begin() -> iterator_pb2.CampaignStatus:
            return self._bus.query(self._bus.keys.campaign_start(), specification, iterator_pb2.CampaignStatus)

        def on_status(status: iterator_pb2.CampaignStatus) -> None:
            if (ended := self.failure()) is not None:
                raise ended
            tell(progress_of(status))

        try:
            return follow_campaign(self._bus, specification.id, begin=begin, on_status=on_status)
        except FaultError as fault:
            raise self._explained(fault) from fault
        except KeyboardInterrupt:
            self._stop_campaign(specification.id)
            raise

    def _stop_campaign(self, id: str) -> None:
        # Best effort: whoever interrupts does not want to wait for a service that is gone.
        with suppress(FaultError, BusError):
            self._bus.query(
                self._bus.keys.campaign_stop(id),
                iterator_pb2.StopCampaignRequest(reason="interrupted by the user"),
                iterator_pb2.CampaignStatus,
                silence_seconds=_STOP_SILENCE_SECONDS,
            )

    def _collect(
        self, specification: iterator_pb2.CampaignSpec, status: iterator_pb2.CampaignStatus, *, folder: Path
    ) -> CampaignResult:
        if status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
            if (ended := self.failure()) is not None:
                raise ended
            sentence = status.fault.message or f"The campaign {status.id!r} ended early: {status.activity}."
            if status.iterations:
                with suppress(FaultError, LabError):
                    kept = fetch_result(self._bus, specification, status, folder=folder).recording_path
                    sentence += f" What was played until then is in {kept}; `duralab report` shows it."
            raise CampaignFaultError(
                sentence,
                field=status.fault.field,
                service=status.fault.service,
            )
        try:
            return fetch_result(self._bus, specification, status, folder=folder)
        except FaultError as fault:
            raise self._explained(fault) from fault

    def _key(self, what: str, make: Callable[[str], str], name: str) -> str:
        try:
            return make(name)
        except ValueError as error:
            raise InputError(str(error), field=what) from error

    def _query(
        self,
        key: str,
        request: Message,
        kind: type[MessageT],
        *,
        on_progress: Callable[[query_pb2.Progress], None] | None = None,
    ) -> MessageT:
        try:
            return self._bus.query(key, request, kind, on_progress=on_progress)
        except FaultError as fault:
            raise self._explained(fault) from fault

    def _explained(self, fault: FaultError) -> LabError:
        """Return a fault as an error for the user: the end of a service explains what it broke."""
        if (ended := self.failure()) is not None:
            return ended
        kind = InputError if fault.code in _INPUT_FAULTS else LabError
        return kind(fault.message, field=fault.field, service=fault.service)


def _tell_nobody(progress: RunProgress) -> None:
    del progress
