"""A lab as a script meets it: its rigs, playing them, running campaigns."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from duralab.arguments import folder_of, progress_callback, require_text
from duralab.campaign import (
    Campaign,
    PartialSettings,
    build_specification,
    check_against_rig,
    load_campaign,
    load_settings,
)
from duralab.data import Signals
from duralab.errors import InputError, LabError
from duralab.lab.campaigns import (
    CampaignResult,
    RecordingsPlace,
    Recovery,
    collect,
    followed,
    free_id,
    recording_file,
    resume_campaign,
    stop_campaign,
)
from duralab.lab.catalogue import Catalogue
from duralab.lab.client import Deadline, LabClient, deadline_of
from duralab.lab.progress import OnProgress, RunProgress, Stage, progress_of
from duralab.lab.rigs import LabRigs
from duralab.lab.status import ServiceHealth, health_of
from duralab.lab.watching import Watch, Watched
from duralab.output_files import OUTPUTS, require_other
from duralab.processes import Supervisor
from duralab.recording import open_recording
from duralab.target import describe_target, make_target
from duralab_bus import Bus, FaultError
from duralab_proto.keys import ANY
from duralab_proto.v1 import iterator_pb2


class Lab(LabRigs):
    """A lab on the bus; made by `start` and `connect`.

    Parameters
    ----------
    bus : Bus
        The session.
    out : Path
        Folder for what campaigns leave behind.
    supervisor : Supervisor, optional
        Of the services, where this process started them.
    recordings : RecordingsPlace, optional
        Where its recorder writes, as far as that is known.
    """

    def __init__(
        self,
        bus: Bus,
        *,
        out: Path,
        supervisor: Supervisor | None = None,
        recordings: RecordingsPlace | None = None,
    ) -> None:
        self.out = out
        self._recordings = recordings or RecordingsPlace()
        self._bus = bus
        self._supervisor = supervisor
        super().__init__(LabClient(bus, self.failure))

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

    @property
    def catalogue(self) -> Catalogue:
        """Finds and checks the recordings that the lab's recorder holds."""
        return Catalogue(self._ask)

    def health(self) -> list[ServiceHealth]:
        """Ask every service how it is: queues, lag, loss, latches, progress; one that is silent says so."""
        return health_of(self._bus)

    def watch(
        self,
        *,
        rig: str = ANY,
        campaign: str = ANY,
        kinds: Sequence[Watched] = tuple(Watched),
        timeout_seconds: float | None = None,
    ) -> Watch:
        """Watch the lab live: an iterator over what rigs play, what they do, and how far campaigns are.

        Parameters
        ----------
        rig : str
            Of this rig only.
        campaign : str
            Of this campaign only; after its end the iterator ends. All, and without end, where not given.
        kinds : sequence of Watched
            What to listen to: signals, rig states, campaigns.
        timeout_seconds : float, optional
            Longest silence; for ever where not given.

        Returns
        -------
        Watch
            It listens from now on, until its `with` statement ends or `close` is called.

        Raises
        ------
        InputError
            There is no such campaign, or something else is to be watched.
        """
        known = tuple(Watched)
        if isinstance(kinds, str) or not isinstance(kinds, Iterable) or any(kind not in known for kind in kinds):
            raise InputError(f"kinds is {kinds!r}; give a list of {', '.join(known)}, or leave it out.", field="kinds")
        return Watch(
            self._ask,
            describe=self.describe,
            rig=rig,
            campaign=campaign,
            kinds=frozenset(kinds),
            timeout_seconds=timeout_seconds,
        )

    def run(
        self,
        campaign: Campaign | str | Path,
        *,
        out: str | Path | None = None,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
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
        timeout_seconds : float, optional
            Longest time from now to the campaign's end; then it is stopped, and its rig is latched.
        cancel : threading.Event, optional
            Set from another thread, it stops the campaign within about a second.

        Returns
        -------
        CampaignResult

        Raises
        ------
        InputError
            The campaign does not fit the rig, or a service refused a value.
        CampaignFaultError
            The campaign ended before its last playback.
        StoppedError, LabTimeoutError
            `cancel` was set, or the time was over.
        LabError
            A service is not there or ended.
        """
        end = deadline_of(timeout_seconds, cancel)
        plan = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
        tell = progress_callback(on_progress)
        id = free_id(self._ask, plan.name)
        folder = folder_of(out, usual=self.out / id)
        tell(RunProgress(Stage.TARGET, "asking the rigs", 0.0, -1.0))
        rig = self.describe(plan.rig)
        check_against_rig(plan, rig)
        vehicle = self.describe(plan.target.vehicle) if plan.target.vehicle is not None else None
        driven: list[Signals] = []

        def drive_road(inputs: Signals) -> Signals:
            driven.append(inputs)
            return self._drive_road(plan, id, inputs, tell=tell, end=end)

        target = make_target(plan, rig=rig, vehicle=vehicle, play=drive_road)
        tell(RunProgress(Stage.TARGET, "target made", 1.0, 0.0))
        specification = build_specification(
            plan, id=id, rig=rig, target=target.signals, source=describe_target(plan.target)
        )
        specification.target_steps.extend(record.to_message() for record in target.records)
        for inputs in driven:
            # With these the target can be made again, sample by sample.
            specification.target_drive.CopyFrom(inputs.to_message())
            specification.target_rig, specification.target_seed = plan.target.vehicle or "", plan.seed

        def begin() -> iterator_pb2.CampaignStatus:
            return self._bus.query(self._bus.keys.campaign_start(), specification, iterator_pb2.CampaignStatus)

        recovery = Recovery(self._ask, id, folder, self._recordings)
        status = followed(self._ask, id, begin=begin, tell=tell, recovery=recovery, deadline=end)
        return collect(self._ask, specification, status, folder=folder, recovery=recovery)

    def resume(
        self,
        id: str | Path,
        *,
        settings: Campaign | PartialSettings | str | Path | None = None,
        from_iteration: int = 0,
        out: str | Path | None = None,
        replace: bool = True,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> CampaignResult:
        """Go on with a campaign that a crash broke off, or take up an ended one again; nothing committed is replayed.

        An ended campaign, one whose recorder ended too, and other settings make a new campaign that names its parent.

        Parameters
        ----------
        id : str or Path
            The campaign, by the name of its recording; or the path of a recording, in a lab that this process started:
            a copy of it is resumed, the file stays as it is.
        settings : str, Path, Campaign or PartialSettings, optional
            A file with `update`, `stop` or both, whose keys take the place of the campaign's own; or a whole campaign,
            whose sections `update` and `stop` do.
        from_iteration : int
            The last playback to build on, from 1; 0 is the last there is.
        out, on_progress, timeout_seconds, cancel
            As for `run`.
        replace : bool
            False refuses to go on where an output would take the place of an existing file.

        Returns
        -------
        CampaignResult
            As from `run`.

        Raises
        ------
        InputError, CampaignFaultError, LabError
            As `run` does.
        """
        folder_of(out, usual=self.out)  # a wrong folder is an error before anything moves
        if not (settings is None or isinstance(settings, Campaign | PartialSettings)):
            settings = load_settings(settings)
        return resume_campaign(
            self._ask,
            self._id_of(id, out=out),
            settings=settings,
            from_iteration=from_iteration,
            describe=self.describe,
            folder=lambda name: folder_of(out, usual=self.out / name),
            place=self._recordings,
            replace=replace,
            tell=progress_callback(on_progress),
            deadline=deadline_of(timeout_seconds, cancel),
        )

    def _id_of(self, given: str | Path, *, out: str | Path | None) -> str:
        """Return the id of the campaign to resume; a recording is copied to where the recorder finds it."""
        path = recording_file(given)
        if path is None:
            return str(given)
        recording = open_recording(path)
        require_other([folder_of(out, usual=self.out) / name for name in OUTPUTS], read=recording.files)
        self._recordings.copy_in(recording)
        return recording.specification.id

    def stop(self, id: str, *, reason: str = "") -> RunProgress:
        """Stop a campaign and return how far it got; one that has ended stays as it is.

        The rig ramps down where it plays, and is latched whatever it does, also between two playbacks. Where its run
        cannot be stopped, the activity says so.

        Parameters
        ----------
        id : str
            The campaign.
        reason : str
            In words; kept in the recording.

        Returns
        -------
        RunProgress
            How far it got.

        Raises
        ------
        InputError
            No such campaign was started or resumed since the iterator began.
        """
        require_text(reason, field="reason")
        try:
            return progress_of(stop_campaign(self._ask, id, reason=reason))
        except FaultError as fault:
            raise self._ask.explained(fault) from fault

    def _drive_road(self, plan: Campaign, id: str, inputs: Signals, *, tell: OnProgress, end: Deadline) -> Signals:
        vehicle = plan.target.vehicle or ""
        tell(RunProgress(Stage.TARGET, f"driving {vehicle} over the road", 0.0, -1.0))
        run = f"{id}.target-{uuid.uuid4().hex[:8]}"

        def tell_of_target(progress: RunProgress) -> None:
            tell(replace(progress, stage=Stage.TARGET))

        return self._play(vehicle, inputs, run=run, seed=plan.seed, tell=tell_of_target, end=end).response
