"""Interface of a lab for scripts: rigs, playing drives, running campaigns."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from duralab.arguments import folder_of, progress_callback, require_text
from duralab.campaign import Campaign, PartialSettings, Project, load_campaign, load_project, load_settings
from duralab.data import Model, Played, PreTest, Proposal, Rig, Rigs, RigState, Signals
from duralab.errors import InputError, LabError
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.campaign_running import free_id, recording_file, resume_campaign, stop_campaign
from duralab.lab.campaign_starting import StartingLab, begin_campaign, run_campaign
from duralab.lab.catalogue import Catalogue
from duralab.lab.client import LabClient, deadline_of
from duralab.lab.deciding import decide, last_drive_of, proposal_of
from duralab.lab.endurance import EnduranceTest, start_endurance
from duralab.lab.identifier import Identifier
from duralab.lab.playing import play_drive, stop_rig
from duralab.lab.pre_testing import make_pre_test
from duralab.lab.progress import OnProgress, RunProgress, progress_of
from duralab.lab.project_result import EventResult, ProjectResult
from duralab.lab.project_running import run_project
from duralab.lab.recordings_folder import RecordingsPlace
from duralab.lab.status import ServiceHealth, health_of
from duralab.lab.watching import Watch, Watched
from duralab.output_files import OUTPUTS, require_other
from duralab.processes import Supervisor
from duralab.recording import open_recording
from duralab.schedule import load_schedule
from duralab_bus import Bus, FaultError
from duralab_proto.keys import ANY
from duralab_proto.v1 import rig_pb2
from duralab_settings import DecisionKind, EstimatorSettings, ExcitationSettings

if TYPE_CHECKING:
    import xarray

    from duralab_schedules import Schedule


class Lab:
    """Lab on the bus; made by `start` and `connect`.

    `out`: Output folder of campaigns. `supervisor`: Supervisor of the services, if this process started them.
    `recordings`: Place of the recorder's files, if known.
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
        self._ask = LabClient(bus, self.failure)

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Endpoints at which other processes can connect to this lab."""
        return self._bus.listening

    def failure(self) -> LabError | None:
        """Return the error of a service of this lab that ended unexpectedly; None if there is none."""
        return self._supervisor.failure() if self._supervisor is not None else None

    def end_services(self) -> None:
        """Begin to end the services that this process started, before the `with` statement ends; request nothing more.

        The services of a lab that this process has joined continue.
        """
        if self._supervisor is not None:
            self._supervisor.begin_stop()

    @property
    def process_ids(self) -> dict[str, int]:
        """Process id of each service that this process started."""
        return self._supervisor.process_ids if self._supervisor is not None else {}

    @property
    def catalogue(self) -> Catalogue:
        """Catalogue of the recordings of the lab's recorder."""
        return Catalogue(self._ask)

    def health(self) -> list[ServiceHealth]:
        """Return the health of each service: queues, lag, loss, latches, progress; silent services are marked."""
        return health_of(self._bus)

    def rig_names(self) -> list[str]:
        """Return the names of all rigs present, also of unusable ones, whose description reports why."""
        return sorted(instance for _, instance in self._ask.bus.live("rig_sim"))

    @property
    def identifier(self) -> Identifier:
        """Identifier of rigs, without a campaign."""
        return Identifier(self._ask, self.describe)

    def rigs(self) -> Rigs:
        """Return all rigs present, by name; raises `LabError` if one of them cannot be used."""
        return Rigs(self.describe(name) for name in self.rig_names())

    def describe(self, rig: str) -> Rig:
        """Return the description of a rig and its limits.

        Parameters
        ----------
        rig : str
            Its name.

        Returns
        -------
        Rig
            Description with channels, limits and sample rate.

        Raises
        ------
        InputError
            There is no such rig.
        """
        key = self._ask.key("rig", self._ask.bus.keys.rig_description, rig)
        known = self.rig_names()
        if rig not in known and self._ask.failure() is None:
            there = (
                f"there are {', '.join(known)}"
                if known
                else "no rig is on the bus, or not yet: see whether rig_sim runs"
            )
            raise InputError(f"There is no rig {rig!r}; {there}.", field="rig")
        return Rig.from_message(self._ask.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription))

    def state(self, rig: str) -> RigState:
        """Return the present state of a rig.

        Parameters
        ----------
        rig : str
            Its name.

        Returns
        -------
        RigState
            State: at rest, playing or latched, and the reason.

        Raises
        ------
        LabError
            The rig is missing.
        """
        key = self._ask.key("rig", self._bus.keys.rig_state, rig)
        return RigState.from_message(self._ask.query(key, rig_pb2.StateRequest(), rig_pb2.RigState))

    def reset(self, rig: str, *, name: str = "", reason: str = "") -> RigState:
        """Clear the latch of a rig, after inspecting it; a rig that is not latched stays unchanged.

        Parameters
        ----------
        rig : str
            Its name.
        name : str
            Name of the person, at most 80 characters; in the rig's state, log and recordings until the next latch.
        reason : str
            Reason why the rig may move again, at most 300 characters; kept like `name`.

        Returns
        -------
        RigState
            State after the reset.

        Raises
        ------
        InputError
            `name` or `reason` is too long or holds control characters.
        LabError
            The rig is missing, does not reach rest, or was stopped again while the reset waited.
        """
        key = self._ask.key("rig", self._bus.keys.rig_reset, rig)
        request = rig_pb2.ResetRequest(command=secrets.token_hex(16), name=name, reason=reason)
        return RigState.from_message(self._ask.query(key, request, rig_pb2.RigState))

    def play(
        self,
        rig: str,
        drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals,
        *,
        run: str | None = None,
        seed: int = 0,
        real_time: bool = False,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> Played:
        """Play a drive on a rig and wait for its response.

        Parameters
        ----------
        rig : str
            Its name.
        drive : array, DataArray, Dataset or Signals, shape (drives, samples)
            A plain array has the units, order and sample rate of the rig's description. Named channels may be in any
            order, and their units and rate are checked; a name without a unit is refused.
        run : str, optional
            Name of the playback, unique on the rig; a new one if not given.
        seed : int
            Seed of the random parts of a simulated rig, 0 to 2^63 - 1.
        real_time : bool
            Play no faster than real time.
        on_progress : callable, optional
            Called with a `RunProgress` about once a second.
        timeout_seconds : float, optional
            Longest time to wait; then the rig is stopped and latched. No limit if omitted.
        cancel : threading.Event, optional
            Set from another thread, it stops the rig and latches it.

        Returns
        -------
        Played
            Response and actuator use.

        Raises
        ------
        InputError
            There is no such rig, or it refused the drive.
        BusyError, NotReadyError
            The rig plays or is latched.
        StoppedError, LabTimeoutError
            The rig was stopped, or the time limit passed.
        LabError
            The rig reached a limit, or left the bus.
        """
        end = deadline_of(timeout_seconds, cancel)
        return play_drive(
            self._ask,
            self.describe(rig),
            drive,
            run=run,
            seed=seed,
            real_time=real_time,
            on_progress=progress_callback(on_progress),
            deadline=end,
        )

    def identify(
        self,
        rig: str,
        excitation: ExcitationSettings,
        estimator: EstimatorSettings,
        *,
        seed: int = 0,
        learn_drive_map: bool = False,
        target: Signals | None = None,
        band: tuple[float, float] | None = None,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> Model:
        """Run an experiment on a rig and return the model; see `Identifier.identify`, and `identifier` for more."""
        return self.identifier.identify(
            rig,
            excitation,
            estimator,
            seed=seed,
            learn_drive_map=learn_drive_map,
            target=target,
            band=band,
            on_progress=on_progress,
            timeout_seconds=timeout_seconds,
            cancel=cancel,
        )

    def pre_test(
        self,
        rig: str,
        *,
        id: str | None = None,
        level: float = 0.05,
        seed: int = 0,
        real_time: bool = False,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> PreTest:
        """Check a rig at rest, then play small pulses on one drive after the other; report faulty channels.

        Parameters
        ----------
        rig : str
            Name of the rig, which no campaign uses.
        id : str, optional
            Name of the recording, which must be new; the rig's name with the time if not given.
        level : float
            Largest share of limits and slew limits that is used, above 0 to 0.05.
        seed : int
            Seed of the random parts of a simulated rig, 0 to 2^63 - 1.
        real_time : bool
            Play no faster than real time.
        on_progress : callable, optional
            Called with a `RunProgress` about once a second; an overdue calibration is reported before anything moves.
        timeout_seconds : float, optional
            Longest time to wait; then the rig is stopped and latched. No limit if omitted.
        cancel : threading.Event, optional
            Set from another thread, it stops the rig and latches it.

        Returns
        -------
        PreTest
            Findings and verdict; prints as a table.

        Raises
        ------
        InputError
            There is no such rig, `level` is not allowed, or `id` exists.
        BusyError, NotReadyError
            A campaign uses the rig, or the rig plays, is latched, or accepts too short drives only.
        StoppedError, LabTimeoutError
            The rig was stopped, or the time limit passed.
        LabError
            The rig or a service left the bus, or nothing can be recorded.
        """
        end, report = deadline_of(timeout_seconds, cancel), progress_callback(on_progress)
        return make_pre_test(
            self._ask,
            self.describe(rig),
            id=id,
            level=level,
            seed=seed,
            real_time=real_time,
            on_progress=report,
            deadline=end,
        )

    def stop_rig(self, rig: str, *, reason: str = "") -> RigState:
        """Ramp a rig down and latch it, in every state; return when it rests.

        If the run cannot be stopped, the rig answers at once with `goes_on` True in its state, and the run continues to
        its end.

        Parameters
        ----------
        rig : str
            Its name.
        reason : str
            Free text; the rig shows it until it is reset.

        Returns
        -------
        RigState
            State: latched, and at rest unless `goes_on`.

        Raises
        ------
        LabError
            The rig is missing, or does not reach rest.
        """
        return stop_rig(self._ask, rig, reason=reason)

    def watch(
        self,
        *,
        rig: str = ANY,
        campaign: str = ANY,
        kinds: Sequence[Watched] = tuple(Watched),
        timeout_seconds: float | None = None,
    ) -> Watch:
        """Watch the lab live: iterate over signals and states of rigs, and the progress of campaigns.

        Parameters
        ----------
        rig : str
            Name of the only rig to watch; all if not given.
        campaign : str
            Id of the only campaign to watch; the iterator ends with it. If not given: all, without end.
        kinds : sequence of Watched
            Kinds of events: signals, rig states, campaigns, endurance tests.
        timeout_seconds : float, optional
            Longest silence; no limit if not given.

        Returns
        -------
        Watch
            Iterator that listens until its `with` statement ends or `close` is called.

        Raises
        ------
        InputError
            There is no such campaign, or a value of `kinds` is not allowed.
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
            A campaign, its file, or the name of a campaign shipped with the package.
        out : str or Path, optional
            Folder for `recording.mcap` and `live.rrd`; `<lab.out>/<name of the campaign>` if not given.
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
            A service is missing or ended.
        """
        plan = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
        return run_campaign(
            self._starting,
            plan,
            folder=lambda id: folder_of(out, usual=self.out / id),
            on_progress=progress_callback(on_progress),
            deadline=deadline_of(timeout_seconds, cancel),
        )

    def begin(
        self,
        campaign: Campaign | str | Path,
        *,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> str:
        """Begin a campaign and return: make the target and send it to the iterator; do not wait for the end.

        The campaign continues without this script; `watch` follows it, `stop` ends it, `catalogue.fetch` copies its
        recording.

        Parameters
        ----------
        campaign, on_progress, timeout_seconds, cancel
            As for `run`, until the campaign has begun.

        Returns
        -------
        str
            Id of the campaign.

        Raises
        ------
        InputError
            The campaign does not fit the rig, or a service refused a value.
        StoppedError, LabTimeoutError
            `cancel` was set, or `timeout_seconds` passed, while the target was made.
        LabError
            A service is missing or ended.
        """
        plan = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
        deadline = deadline_of(timeout_seconds, cancel)
        return begin_campaign(self._starting, plan, on_progress=progress_callback(on_progress), deadline=deadline)

    def run_project(
        self,
        project: Project | str | Path,
        *,
        out: str | Path | None = None,
        on_progress: OnProgress | None = None,
        on_event: Callable[[EventResult], None] | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> ProjectResult:
        """Run the events of a project: identify each rig once; start each event from the most similar event's result.

        Existing results in `out` are used: an ended event is read, an interrupted one is resumed. Writes a report, the
        drives of all events and their order file.

        Parameters
        ----------
        project : Project, str or Path
            A project, its file, or the name of a project shipped with the package.
        out : str or Path, optional
            Folder with a folder for each event; `<lab.out>/<name of the project>` if not given.
        on_progress : callable, optional
            Called with every `RunProgress`, one call at a time.
        on_event : callable, optional
            Called with the `EventResult` of each event when the event has ended, one call at a time.
        timeout_seconds : float, optional
            Longest time from now to the end of the last event; then the running event is stopped, and its rig latched.
        cancel : threading.Event, optional
            Set from another thread, it stops the project within about a second.

        Returns
        -------
        ProjectResult
            Results of all events, also of those that ended early; prints as a table.

        Raises
        ------
        InputError
            An event does not fit its rig, or `out` holds recordings that were made with other settings.
        StoppedError, LabTimeoutError
            `cancel` was set, or the time was over.
        LabError
            A service is missing or ended.
        """
        plan = project if isinstance(project, Project) else load_project(project)
        return run_project(
            self._starting,
            plan,
            folder=folder_of(out, usual=self.out / plan.name),
            on_progress=progress_callback(on_progress),
            deadline=deadline_of(timeout_seconds, cancel),
            on_event=progress_callback(on_event),
        )

    @property
    def _starting(self) -> StartingLab:
        return StartingLab(self._ask, self.describe, self._recordings)

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
        """Continue a campaign that a crash interrupted, or resume an ended one; committed steps are not replayed.

        A new campaign that names its parent is made if the campaign or its recorder ended, or if settings are given.

        Parameters
        ----------
        id : str or Path
            Name of the campaign's recording; or, in a lab that this process started, the path of a recording: a copy is
            resumed, and the file stays unchanged.
        settings : str, Path, Campaign or PartialSettings, optional
            A file with `update`, `stop` or both, whose keys replace the campaign's; or a whole campaign, whose sections
            `update` and `stop` replace the campaign's.
        from_iteration : int
            Playback to continue from, from 1; 0 is the last playback.
        out, on_progress, timeout_seconds, cancel
            As for `run`.
        replace : bool
            Whether outputs may replace existing files.

        Returns
        -------
        CampaignResult
            Result, as from `run`.

        Raises
        ------
        InputError, CampaignFaultError, LabError
            As for `run`.
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
            on_progress=progress_callback(on_progress),
            deadline=deadline_of(timeout_seconds, cancel),
        )

    def _id_of(self, given: str | Path, *, out: str | Path | None) -> str:
        """Return the id of the campaign to resume; a recording is copied into the recorder's folder."""
        path = recording_file(given)
        if path is None:
            return str(given)
        recording = open_recording(path)
        require_other([folder_of(out, usual=self.out) / name for name in OUTPUTS], read=recording.files)
        self._recordings.copy_in(recording)
        return recording.specification.id

    def endure(
        self,
        schedule: Schedule | str | Path,
        *,
        id: str | None = None,
        seed: int = 0,
        real_time: bool = False,
    ) -> EnduranceTest:
        """Start an endurance test, which plays, monitors and records every repeat of a schedule; return at once.

        Parameters
        ----------
        schedule : Schedule, str or Path
            A schedule or its file.
        id : str, optional
            Name of the test, which must be new; if not given the schedule's, with a number if that exists.
        seed : int
            Seed of the random parts of a simulated rig, 0 to 2^63 - 1.
        real_time : bool
            Play no faster than real time.

        Returns
        -------
        EnduranceTest
            Test, which continues in the lab also after this process ends.

        Raises
        ------
        InputError
            The schedule, a drive or the rig does not fit, the damage is more than planned, or the disk has too little
            space for the test.
        BusyError, NotReadyError
            The rig is in use or latched.
        LabError
            The lab has no sequencer, or a service left the bus.
        """
        plan = load_schedule(schedule) if isinstance(schedule, str | Path) else schedule
        return start_endurance(
            self._ask,
            self.describe(plan.rig),
            plan,
            id=id or free_id(self._ask, plan.name),
            seed=seed,
            real_time=real_time,
            recordings=self._recordings.folder,
        )

    def endurance(self, id: str) -> EnduranceTest:
        """Return an endurance test of this lab, to follow, hold, decide, resume or stop it.

        Parameters
        ----------
        id : str
            Its name.

        Returns
        -------
        EnduranceTest
            Test; no request is sent before its first use.
        """
        return EnduranceTest(self._ask, id)

    def proposal(self, id: str) -> Proposal | None:
        """Return the proposal of a campaign at a hold point, with the drive and the predicted responses.

        Parameters
        ----------
        id : str
            The campaign.

        Returns
        -------
        Proposal or None
            None if the campaign waits for no decision.

        Raises
        ------
        InputError
            No such campaign was started or resumed since the iterator began.
        """
        return proposal_of(self._ask, id)

    def last_drive(self, id: str, playback: int) -> Signals | None:
        """Return the drive of a playback of a campaign that waits at a hold point.

        Parameters
        ----------
        id : str
            The campaign.
        playback : int
            Number of the playback, from 1, as in `Proposal.follows`.

        Returns
        -------
        Signals or None
            None if `playback` is 0 or has no recorded samples.

        Raises
        ------
        LabError
            There is no such recording.
        """
        return last_drive_of(self._ask, id, playback)

    def decide(
        self,
        id: str,
        kind: DecisionKind | str,
        *,
        proposal: int,
        name: str,
        reason: str,
        settings: Mapping[str, Any] | PartialSettings | str | Path | None = None,
        from_iteration: int = 0,
    ) -> RunProgress:
        """Decide on a campaign's proposal at a hold point; return when the decision is recorded.

        Parameters
        ----------
        id : str
            The campaign.
        kind : DecisionKind or str
            "play" the drive; "change" settings and make it again; go "back" to an earlier playback and make it again;
            "end" the campaign.
        proposal : int
            Number of the proposal; a decision on another proposal, or a second decision, is refused.
        name, reason : str
            Name of the person who decides, up to 80 characters, and reason, up to 1000; both are recorded.
        settings : mapping, str or Path, optional
            For "change": `update`, `control_band` or both, each with the changed keys, or a YAML file with them.
        from_iteration : int
            For "back": playback from which the next drive is made.

        Returns
        -------
        RunProgress
            Progress of the campaign.

        Raises
        ------
        InputError
            A value is not allowed, or there is no such campaign.
        NotReadyError
            The campaign does not wait for a decision on this proposal.
        """
        return progress_of(
            decide(
                self._ask,
                id,
                kind,
                proposal=proposal,
                name=name,
                reason=reason,
                settings=settings,
                from_iteration=from_iteration,
                describe=self.describe,
            )
        )

    def stop(self, id: str, *, reason: str = "") -> RunProgress:
        """Stop a campaign and return its progress; an ended campaign stays unchanged.

        A playing rig ramps down. The rig is latched in every state, also between two playbacks. If its run cannot be
        stopped, the activity reports it.

        Parameters
        ----------
        id : str
            The campaign.
        reason : str
            Free text; kept in the recording.

        Returns
        -------
        RunProgress
            Progress at the stop.

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
