"""Endurance tests of the SDK: start from a schedule, follow, hold, decide, resume, stop."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
from google.protobuf.message import Message

from duralab.arguments import require_seed, require_switch, require_text
from duralab.data import Rig, Signals
from duralab.display import text_table
from duralab.errors import InputError
from duralab.lab.client import LabClient, deadline_of
from duralab.lab.playing import drive_signals
from duralab.schedule import forecast_schedule, schedule_text
from duralab_loads import channel_damage
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import recorder_pb2, sequencer_pb2
from duralab_schedules import Schedule
from duralab_settings import parse_yaml

POLL_SECONDS: Final = 0.5
_PREFIX: Final = "ENDURANCE_PHASE_"


class EndurancePhase(StrEnum):
    """Phase of an endurance test."""

    CHECKING = "checking"
    PLAYING = "playing"
    HOLDING = "holding"
    ITERATING = "iterating"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAULTED = "faulted"


ENDED: Final = frozenset({EndurancePhase.FINISHED, EndurancePhase.STOPPED, EndurancePhase.FAULTED})


class EnduranceChoice(StrEnum):
    """Decisions at a hold of an endurance test."""

    CONTINUE = "continue"
    ITERATE_AGAIN = "iterate_again"
    RELEARN = "relearn"
    END = "end"


@dataclass(frozen=True)
class EnduranceProgress:
    """Progress of an endurance test.

    Parameters
    ----------
    id, rig : str
        Name of the test, and the rig that plays it.
    phase : EndurancePhase
        Phase of the test.
    activity : str
        Phase as text.
    repeats, played, unknown : int
        Numbers of repeats of the schedule, of those counted as played, and of played ones whose end is unknown.
    remaining_seconds : float
        Expected time to the end; negative if unknown.
    events : dict of str to tuple of int
        Numbers of played and planned repeats of each event.
    damage, planned, planned_whole : dict of str to float
        Damage by response: counted so far, that of corrections included, planned for the repeats played, and planned
        for the whole schedule; the last two are empty if unknown. Planned is the damage of the response measured in the
        campaign of the drive, for each repeat, as `ScheduleForecast` has it; that of the target for a drive file.
    alarms : int
        Number of alarms so far.
    last_alarms : tuple of str
        Latest alarms, one sentence each.
    hold : int
        Number of the present hold; 0 if the test does not wait.
    reason : str
        Reason why the test waits or ended early.
    remarks : tuple of str
        Remarks for the operator.
    recording : str
        Id of the present recording.
    kept : int
        Number of repeats recorded with all samples.
    hold_alarms : int
        Number of alarms that caused the hold; 0 if an operator or a fault caused it.
    correction_playbacks : int
        Number of playbacks of campaigns that corrected a drive ("iterate again").
    correction_damage : dict of str to float
        Part of these playbacks in `damage`, by response; empty in the status of an older sequencer.
    """

    id: str
    rig: str
    phase: EndurancePhase
    activity: str
    repeats: int
    played: int
    unknown: int
    remaining_seconds: float
    events: dict[str, tuple[int, int]]
    damage: dict[str, float]
    planned: dict[str, float]
    alarms: int
    last_alarms: tuple[str, ...]
    hold: int
    reason: str
    remarks: tuple[str, ...]
    recording: str
    kept: int
    planned_whole: dict[str, float] = field(default_factory=dict)
    hold_alarms: int = 0
    correction_playbacks: int = 0
    correction_damage: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_message(cls, status: sequencer_pb2.EnduranceStatus) -> EnduranceProgress:
        """Return the progress from a status message."""
        names = list(status.responses)

        def by_response(array_name: str) -> dict[str, float]:
            if not status.HasField(array_name):
                return {}
            values = from_array(getattr(status, array_name), field=array_name, shape=(len(names),), dtype=np.float64)
            return dict(zip(names, map(float, values), strict=True))

        phase = sequencer_pb2.EndurancePhase.Name(status.phase).removeprefix(_PREFIX).lower()
        return cls(
            id=status.id,
            rig=status.rig,
            phase=EndurancePhase(phase),
            activity=status.activity,
            repeats=status.repeats,
            played=status.played,
            unknown=status.unknown,
            remaining_seconds=status.remaining_seconds,
            events={event.name: (event.played, event.planned) for event in status.events},
            damage=by_response("damage"),
            planned=by_response("damage_planned_so_far"),
            alarms=status.alarms,
            last_alarms=tuple(alarm.sentence for alarm in status.last_alarms),
            hold=status.hold.number if status.HasField("hold") else 0,
            reason=status.hold.reason if status.HasField("hold") else status.fault.message,
            remarks=tuple(status.remarks),
            recording=status.recording,
            kept=status.kept,
            planned_whole=by_response("damage_planned"),
            hold_alarms=len(status.hold.alarms),
            correction_playbacks=status.correction_playbacks,
            correction_damage=by_response("correction_damage"),
        )

    def __str__(self) -> str:
        """Return the progress as a few lines and a table of the events."""
        unknown = f", of which the end of {self.unknown} is not known" if self.unknown else ""
        left = f", {self.remaining_seconds:.0f} s left" if self.remaining_seconds > 0 else ""
        lines = [
            f"Endurance test {self.id} on {self.rig}: {self.activity}",
            f"{self.played} of {self.repeats} repeats{unknown}{left}; {self.kept} with all samples; "
            f"{self.alarms} alarms",
        ]
        if self.correction_playbacks:
            pairs = [(self.damage[name], part) for name, part in self.correction_damage.items()]
            share = max((part / counted for counted, part in pairs if counted > 0.0), default=0.0)
            part = f"up to {100.0 * share:.2g} % of the damage of a channel"
            lines.append(f"{self.correction_playbacks} playbacks corrected drives: {part} is by corrections")
        if self.reason:
            lines.append(f"Hold {self.hold}: {self.reason}" if self.hold else self.reason)
        lines += [*self.last_alarms[-3:], *self.remarks[-3:]]
        rows = [(name, str(played), str(planned)) for name, (played, planned) in self.events.items()]
        table = text_table(("event", "played", "planned"), rows, left=1) if rows else ""
        return "\n".join([*lines, table]).rstrip()


def start_endurance(
    ask: LabClient, rig: Rig, schedule: Schedule, *, id: str, seed: int, real_time: bool, recordings: Path | None
) -> EnduranceTest:
    """Start an endurance test; see `Lab.endure`."""
    require_seed(seed)
    require_switch(real_time, field="real_time")
    expected = forecast_schedule(schedule, recordings=recordings)
    free = shutil.disk_usage(recordings).free if recordings is not None and recordings.is_dir() else None
    expected.require_playable(free_bytes=free)
    spec = sequencer_pb2.EnduranceSpec(
        id=id,
        rig=rig.name,
        schedule=schedule_text(expected.self_contained, folder=schedule.folder),
        seed=seed,
        real_time=bool(real_time),
    )
    exponent = float(schedule.monitoring.damage_exponent)
    for name, event in expected.events.items():
        message = spec.events.add(name=name, source=event.source, campaign=event.campaign)
        message.drive.CopyFrom(drive_signals(event.drive, rig).to_message())
        # The damage that the schedule was designed with and that its forecast shows.
        if event.measured is not None:
            message.planned_damage.CopyFrom(to_array(_damage(event.measured, rig, exponent, event=name)))
    ask.query(ask.bus.keys.endurance_start(rig.name), spec, sequencer_pb2.EnduranceStatus)
    return EnduranceTest(ask, id, rig.name, notes=expected.notes)


def _damage(planned: Signals, rig: Rig, exponent: float, *, event: str) -> np.ndarray:
    """Return the damage of a target or a response in the order of the rig's responses."""
    units = {channel.name: channel.unit for channel in rig.responses}
    for channel in planned.channels:
        if units.get(channel.name, channel.unit) != channel.unit:
            raise InputError(
                f"{channel.name} of event {event} is in {channel.unit} and the rig {rig.name!r} measures it in "
                f"{units[channel.name]}; give the target of that channel.",
                field=f"events.{event}.target",
            )
    damage = dict(zip(planned.names, channel_damage(planned.samples, exponents=[exponent])[:, 0], strict=True))
    if missing := [channel.name for channel in rig.responses if channel.name not in damage]:
        raise InputError(
            f"The target of event {event} has no channel {', '.join(missing)}; it has {', '.join(damage)}, so give one "
            f"with all responses of rig {rig.name!r}.",
            field=f"events.{event}.target",
        )
    return np.array([damage[channel.name] for channel in rig.responses])


class EnduranceTest:
    """Endurance test of a lab; made by `Lab.endure` and `Lab.endurance`.

    `id`: Name of the test. `rig`: Rig that plays it; read from the recording if not given. `notes`: Notes of the
    schedule's forecast; empty for a test that was started elsewhere.
    """

    def __init__(self, ask: LabClient, id: str, rig: str = "", *, notes: tuple[str, ...] = ()) -> None:
        self._ask = ask
        self.id = id
        self.notes = notes
        """What the forecast of the schedule says, e.g. of events in which nothing can be detected."""
        self._rig = rig

    def progress(self) -> EnduranceProgress:
        """Return the progress; raises InputError if the sequencer has no such test, e.g. after its restart."""
        return EnduranceProgress.from_message(self._status())

    def _status(self) -> sequencer_pb2.EnduranceStatus:
        key = self._ask.key("id", self._ask.bus.keys.endurance, self.id)
        return self._ask.query(key, sequencer_pb2.EnduranceRequest(), sequencer_pb2.EnduranceStatus)

    @property
    def rig(self) -> str:
        """Rig that plays the test, from its first recording."""
        if not self._rig:
            key = self._ask.key("id", self._ask.bus.keys.recording_steps, self.id)
            answer = self._ask.query(key, recorder_pb2.ReadStepsRequest(), recorder_pb2.RecordedSteps)
            first = answer.steps[0] if answer.steps else recorder_pb2.RecordedStep()
            if first.message_type != sequencer_pb2.EnduranceSpec.DESCRIPTOR.full_name:
                raise InputError(
                    f"The recording {self.id!r} is not that of an endurance test; give the id of one.", field="id"
                )
            self._rig = sequencer_pb2.EnduranceSpec.FromString(first.payload).rig
        return self._rig

    def history(self) -> EnduranceHistory:
        """Return a reader of the test's recordings, from its first repeat on.

        Returns
        -------
        EnduranceHistory
            Reader before its first `read`.
        """
        return EnduranceHistory(self._ask, self.id)

    def wait(
        self,
        *,
        on_progress: Callable[[EnduranceProgress], None] | None = None,
        until_hold: bool = False,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> EnduranceProgress:
        """Wait for the end of the test; the test continues in the lab if the wait ends early.

        Parameters
        ----------
        on_progress : callable, optional
            Called with an `EnduranceProgress` twice a second.
        until_hold : bool
            Also return when the test holds.
        timeout_seconds : float, optional
            Longest time to wait.
        cancel : threading.Event, optional
            Set from another thread, it ends the wait.

        Returns
        -------
        EnduranceProgress
            Progress at the end, or at the hold.

        Raises
        ------
        StoppedError, LabTimeoutError
            `cancel` was set, or `timeout_seconds` passed.
        LabError
            The sequencer is not on the bus.
        """
        end = deadline_of(timeout_seconds, cancel)
        while True:
            progress = self.progress()
            if on_progress is not None:
                on_progress(progress)
            if progress.phase in ENDED or (until_hold and progress.phase is EndurancePhase.HOLDING):
                return progress
            if end.is_set():
                raise end.error(f"The wait for the endurance test {self.id!r}")
            time.sleep(POLL_SECONDS)

    def hold(self, *, reason: str = "") -> EnduranceProgress:
        """Hold the test after the current repeat.

        Parameters
        ----------
        reason : str
            Free text; kept in the recording.

        Returns
        -------
        EnduranceProgress
            Progress after the request.
        """
        require_text(reason, field="reason")
        key = self._ask.key("id", self._ask.bus.keys.endurance_hold, self.id)
        return self._progress(key, sequencer_pb2.HoldEnduranceRequest(reason=reason))

    def resume(self) -> EnduranceProgress:
        """Continue after a hold by an operator or a fault, or after a crash of the sequencer."""
        key = self._ask.bus.keys.endurance_resume(self.id, self.rig)
        return self._progress(key, sequencer_pb2.ResumeEnduranceRequest())

    def decide(self, choice: EnduranceChoice | str, *, hold: int, name: str, reason: str) -> EnduranceProgress:
        """Decide on a hold; return when the decision is recorded.

        Parameters
        ----------
        choice : EnduranceChoice or str
            "continue"; "iterate_again" corrects the drive of the events with alarms; "relearn" learns the baselines
            again, as after a repair; "end".
        hold : int
            Number of the hold: a decision on another one, or a second one, is refused.
        name, reason : str
            Name of the person who decides, up to 80 characters, and reason, up to 1000; both are recorded.

        Returns
        -------
        EnduranceProgress
            Progress after the request.

        Raises
        ------
        InputError
            A value is not allowed.
        NotReadyError
            The test does not wait at this hold, or the rig cannot play.
        """
        if choice not in tuple(EnduranceChoice):
            raise InputError(f"The choice is {choice!r}; allowed are {', '.join(EnduranceChoice)}.", field="choice")
        decision = sequencer_pb2.EnduranceDecision(
            hold=hold,
            kind=getattr(sequencer_pb2, f"ENDURANCE_DECISION_KIND_{EnduranceChoice(choice).name}"),
            name=name,
            reason=reason,
        )
        key = self._ask.bus.keys.endurance_decide(self.id, self.rig)
        return self._progress(key, decision)

    def stop(self, *, reason: str = "") -> EnduranceProgress:
        """End the test, and stop and latch its rig; a test that has ended stays unchanged.

        Parameters
        ----------
        reason : str
            Free text; kept in the recording.

        Returns
        -------
        EnduranceProgress
            Progress at the stop.
        """
        require_text(reason, field="reason")
        key = self._ask.key("id", self._ask.bus.keys.endurance_stop, self.id)
        return self._progress(key, sequencer_pb2.StopEnduranceRequest(reason=reason))

    def _progress(self, key: str, request: Message) -> EnduranceProgress:
        """Query the sequencer and return the test's progress."""
        return EnduranceProgress.from_message(self._ask.query(key, request, sequencer_pb2.EnduranceStatus))


@dataclass(frozen=True)
class EnduranceAlarm:
    """Alarm of an endurance test.

    Parameters
    ----------
    repeat, event, since : int, str, int
        Repeat in which the alarm was found, from 0, its event, and the repeat in which the change began.
    level, kind, action : str
        "warning" or "abort"; "limit", "sudden change" or "slow drift"; reaction: "log", "hold", "stop" or
        "iterate again".
    channel : str
        Response with the change.
    band : tuple of float or None
        Lowest and highest frequency in Hz; None if the change is not limited to a band.
    measure : str
        Changed quantity, e.g. "gain" or "rms".
    size : float
        Change as a share of the baseline, or the value at an absolute limit.
    sentence : str
        Description of the alarm as a sentence.
    found : datetime.datetime or None
        Time at which the sequencer found it, in UTC; None in a recording of an older version, which has no time.
    """

    repeat: int
    event: str
    since: int
    level: str
    kind: str
    action: str
    channel: str
    band: tuple[float, float] | None
    measure: str
    size: float
    sentence: str
    found: datetime | None = None


@dataclass(frozen=True, eq=False)
class PlayedRepeat:
    """Recorded repeat of an endurance test.

    Parameters
    ----------
    repeat, event : int, str
        Number from 0, and the event that was played.
    baseline : tuple of int
        Number of the drive, and number of times that all baselines were relearned; repeats of an event with the same
        value have the same baseline.
    statistics : np.ndarray or None, shape (responses, columns)
        Columns as in `EnduranceHistory.columns`; None if the end of the repeat is unknown.
    alarms : tuple of EnduranceAlarm
        Alarms found in the repeat.
    reason : str
        Reason why its end is unknown; empty if it is known.
    """

    repeat: int
    event: str
    baseline: tuple[int, int]
    statistics: np.ndarray | None
    alarms: tuple[EnduranceAlarm, ...]
    reason: str


class EnduranceHistory:
    """Reader of the recordings of an endurance test, also while it runs; made by `EnduranceTest.history`.

    `id`: Name of the test.
    """

    def __init__(self, ask: LabClient, id: str) -> None:
        self._ask, self.id = ask, id
        self._volume, self._next = 1, 0
        self._relearnt = 0
        self.schedule: Schedule | None = None
        self.sources: dict[str, str] = {}
        self.columns: tuple[str, ...] = ()
        self.decisions: list[tuple[int, str, str, str]] = []
        self.kept: list[int] = []

    def read(self) -> list[PlayedRepeat]:
        """Return repeats recorded since the last call, a limited number per call.

        Also updates the attributes: `schedule`, `sources` (the source of each event's drive),
        `columns` (names of the statistics), `decisions` (hold, kind, name, reason) and `kept` (repeats with all
        samples).

        Returns
        -------
        list of PlayedRepeat
            New repeats in order; empty if there are none.

        Raises
        ------
        LabError
            There is no such recording, or no recorder.
        """
        name = self.id if self._volume == 1 else f"{self.id}-v{self._volume:04d}"
        key = self._ask.key("id", self._ask.bus.keys.recording_steps, name)
        request = recorder_pb2.ReadStepsRequest(first=self._next)
        try:
            steps = self._ask.query(key, request, recorder_pb2.RecordedSteps).steps
        except InputError:
            # The next recording begins with the next repeat, which may come late or never.
            if self._volume == 1:
                raise
            return []
        played = [repeat for step in steps if (repeat := self._take(step)) is not None]
        if any(step.message_type == recorder_pb2.RecordingClosed.DESCRIPTOR.full_name for step in steps):
            self._volume, self._next = self._volume + 1, 0
        elif steps:
            self._next = steps[-1].step + 1
        return played

    def _take(self, step: recorder_pb2.RecordedStep) -> PlayedRepeat | None:
        kinds = (
            sequencer_pb2.EnduranceSpec,
            sequencer_pb2.EnduranceVolume,
            sequencer_pb2.EnduranceRepeat,
            sequencer_pb2.RepeatSamples,
            sequencer_pb2.EnduranceDecision,
        )
        kind = next((each for each in kinds if each.DESCRIPTOR.full_name == step.message_type), None)
        match None if kind is None else kind.FromString(step.payload):
            case sequencer_pb2.EnduranceSpec() as spec:
                self.schedule = Schedule.model_validate(parse_yaml(spec.schedule))
                self.sources = {event.name: event.source for event in spec.events}
            case sequencer_pb2.EnduranceVolume() as volume:
                self.columns = tuple(volume.columns)
            case sequencer_pb2.RepeatSamples() as samples:
                self.kept.append(samples.repeat)
            case sequencer_pb2.EnduranceDecision() as decision:
                chosen = sequencer_pb2.EnduranceDecisionKind.Name(decision.kind)
                words = chosen.removeprefix("ENDURANCE_DECISION_KIND_").lower().replace("_", " ")
                self.decisions.append((decision.hold, words, decision.name, decision.reason))
                self._relearnt += decision.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_RELEARN
            case sequencer_pb2.EnduranceRepeat() as repeat:
                return self._played(repeat)
        return None

    def _played(self, step: sequencer_pb2.EnduranceRepeat) -> PlayedRepeat:
        if step.samples_hash:
            self.kept.append(step.repeat)
        names = tuple(self.sources)
        known = step.HasField("statistics")
        shape = (None, len(self.columns))
        return PlayedRepeat(
            repeat=step.repeat,
            event=names[step.event],
            baseline=(step.drive, self._relearnt),
            statistics=from_array(step.statistics, field="statistics", shape=shape, finite=False) if known else None,
            alarms=tuple(_alarm(alarm, names) for alarm in step.alarms),
            reason=step.reason,
        )


def _alarm(message: sequencer_pb2.EnduranceAlarm, events: tuple[str, ...]) -> EnduranceAlarm:
    def words(name: str) -> str:
        return name.split("_", 2)[2].lower().replace("_", " ")

    has_band = message.highest_frequency > 0.0
    return EnduranceAlarm(
        repeat=message.repeat,
        event=events[message.event],
        since=message.since_repeat,
        level=words(sequencer_pb2.AlarmLevel.Name(message.level)),
        kind=words(sequencer_pb2.AlarmKind.Name(message.kind)),
        action=words(sequencer_pb2.AlarmAction.Name(message.action)),
        channel=message.channel,
        band=(message.lowest_frequency, message.highest_frequency) if has_band else None,
        measure=message.measure,
        size=message.size,
        sentence=message.sentence,
        found=datetime.fromtimestamp(message.found / 1e9, UTC) if message.found else None,
    )
