"""One endurance test whose services are killed at seeded moments, and the proof of what became of it."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from duralab_bus import FaultError
from duralab_proto.arrays import to_record
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from duralab_schedules import EventLoad, Schedule, forecast
from duralab_settings import parse_yaml

from .counting_rig import RIG
from .killable_services import SERVICES, KillableServices

ENDED = (
    sequencer_pb2.ENDURANCE_PHASE_FINISHED,
    sequencer_pb2.ENDURANCE_PHASE_STOPPED,
    sequencer_pb2.ENDURANCE_PHASE_FAULTED,
)
SECONDS = 1.0
POLL_SECONDS = 0.02


@dataclass
class Outcome:
    """What became of an endurance test.

    `lost`, `doubled`: Repeats without a committed step or with two, and repeats that the rig played twice. `memory`:
    Resident memory of each service in MiB, by repeats played.
    """

    repeats: int
    kills: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    unknown: int = 0
    lost: list[int] = field(default_factory=list)
    doubled: list[int] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    memory: list[tuple[int, dict[str, float]]] = field(default_factory=list)
    recordings: int = 0
    bytes: int = 0
    forecast_bytes: int = 0
    kept: int = 0
    alarms: int = 0


def specification(services: KillableServices, id: str, *, repeats: int, extra: str = "") -> sequencer_pb2.EnduranceSpec:
    """Return an endurance test of two short events."""
    bus = services.bus
    description = bus.query(bus.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    rate = description.sample_rate
    time_of = np.arange(round(SECONDS * rate)) / rate
    window = np.sin(np.pi * time_of / SECONDS) ** 2
    schedule = f"""
name: {id}
rig: {RIG}
order: interleaved
events:
  cobbles: {{drive: cobbles.csv, repeats: {repeats - repeats // 3}}}
  kerb: {{drive: kerb.csv, repeats: {repeats // 3}}}
monitoring: {{bands: [2.0, 10.0, 40.0]}}
{extra or "keep: {first: 2, every: 500, around_alarm: 2}"}
"""
    spec = sequencer_pb2.EnduranceSpec(id=id, rig=RIG, schedule=schedule, seed=7)
    for name, frequencies in (("cobbles", (5.0, 13.0)), ("kerb", (3.0, 21.0))):
        drive = 0.05 * window * np.sin(2.0 * np.pi * np.outer(frequencies, time_of))
        record = to_record(description.drives, rate, drive)
        spec.events.add(name=name, drive=record, source="a test")
    return spec


class DisturbedTest:
    """Runs an endurance test to its end, killing a service every so many repeats."""

    def __init__(self, services: KillableServices, spec: sequencer_pb2.EnduranceSpec, outcome: Outcome) -> None:
        self._services = services
        self._spec = spec
        self._keys = services.bus.keys
        self.outcome = outcome

    def run(
        self,
        *,
        kill_every: int,
        seed: int,
        victims: Sequence[str] = (),
        on_progress: Callable[[int], None] = lambda _: None,
        sample_every: int = 500,
    ) -> Outcome:
        """Start it, kill `victims` one after the other, then random ones; resume until it has ended, and prove it."""
        waiting = list(victims)
        generator = random.Random(seed)
        begun = time.monotonic()
        self._ask(self._keys.endurance_start(RIG), self._spec)
        next_kill = self._after(0, kill_every, generator)
        next_sample = sample_every
        while True:
            status = self._status()
            if status is not None and status.phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED:
                break
            if status is None or status.phase in ENDED or status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING:
                refused = self._go_on(status)
                # A sequencer that was killed after the end knows nothing of it; the recordings do.
                if status is None and refused and (status := self._recorded_end()) is not None:
                    break
                continue
            if status.played >= next_sample:
                self.outcome.memory.append((status.played, self._services.resident_mebibytes()))
                on_progress(status.played)
                next_sample = status.played + sample_every
            if kill_every and status.played >= next_kill:
                victim = waiting.pop(0) if waiting else generator.choice(SERVICES)
                time.sleep(generator.uniform(0.0, 0.05))
                self._services.kill(victim)
                self.outcome.kills[victim] += 1
                self._services.start(victim)
                next_kill = self._after(status.played, kill_every, generator)
            time.sleep(POLL_SECONDS)
        self.outcome.seconds = time.monotonic() - begun
        self.outcome.kept, self.outcome.alarms = status.kept, status.alarms
        self._prove()
        return self.outcome

    @staticmethod
    def _after(played: int, every: int, generator: random.Random) -> int:
        return played + every + generator.randrange(-(every // 5), every // 5 + 1) if every else 0

    def _ask(self, key, request):
        return self._services.bus.query(key, request, sequencer_pb2.EnduranceStatus)

    def _status(self) -> sequencer_pb2.EnduranceStatus | None:
        """Ask how it stands; None where nobody knows."""
        try:
            return self._ask(self._keys.endurance(self._spec.id), sequencer_pb2.EnduranceRequest())
        except FaultError:
            return None

    def _recorded_end(self) -> sequencer_pb2.EnduranceStatus | None:
        """Return the status with which the recordings end; None where the last is not closed with it."""
        steps = list(recorded_steps(self._services, self._spec.id))
        if not steps or not isinstance(steps[-1], recorder_pb2.RecordingClosed):
            return None
        ended = [step for step in steps if isinstance(step, sequencer_pb2.EnduranceStatus)]
        finished = [status for status in ended if status.phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED]
        return finished[0] if finished else None

    def _go_on(self, status: sequencer_pb2.EnduranceStatus | None) -> bool:
        """Do as an operator does: look at the rig, reset it, resume; return whether that was refused for its state."""
        self._services.wait_until_whole()
        bus = self._services.bus
        try:
            state = bus.query(self._keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)
            if state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
                bus.query(self._keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)
            self._ask(self._keys.endurance_resume(self._spec.id, RIG), sequencer_pb2.ResumeEnduranceRequest())
        except FaultError as fault:
            if fault.code not in (
                query_pb2.FAULT_CODE_BUSY,
                query_pb2.FAULT_CODE_UNAVAILABLE,
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                query_pb2.FAULT_CODE_ALREADY_EXISTS,
            ):
                raise
            self.outcome.findings += [
                f"held by an alarm: {status.hold.reason}" for _ in [0] if status and status.hold.alarms
            ][:1]
            time.sleep(0.1)
            return fault.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
        return False

    def _forecast_bytes(self) -> int:
        schedule = Schedule.model_validate(parse_yaml(self._spec.schedule))
        loads = {}
        for event in self._spec.events:
            drives, samples = event.drive.samples.shape
            # The rig has as many responses as drives.
            rate = event.drive.sample_rate
            loads[event.name] = EventLoad(samples=samples, sample_rate=rate, drives=drives, responses=drives)
        return forecast(schedule, loads).bytes

    def _prove(self) -> None:
        """Read all recordings, and compare them with the rig's ledger."""
        outcome = self.outcome
        repeats = [
            message
            for message in recorded_steps(self._services, self._spec.id)
            if isinstance(message, sequencer_pb2.EnduranceRepeat)
        ]
        counted = Counter(repeat.repeat for repeat in repeats)
        outcome.lost = [repeat for repeat in range(outcome.repeats) if not counted[repeat]]
        runs = self._services.ledger.read_text().split()
        begun = Counter(repeat_of(run) for run in runs if run.startswith(f"{self._spec.id}.r"))
        outcome.doubled = sorted(
            {repeat for repeat, count in counted.items() if count > 1}
            | {repeat for repeat, count in begun.items() if count > 1}
        )
        unknown = [repeat for repeat in repeats if repeat.end == sequencer_pb2.REPEAT_END_UNKNOWN]
        outcome.unknown = len(unknown)
        outcome.findings += [
            f"repeat {repeat.repeat} was counted as measured and not played"
            for repeat in repeats
            if repeat.end == sequencer_pb2.REPEAT_END_PLAYED and begun[repeat.repeat] != 1
        ][:10]
        if [repeat.repeat for repeat in repeats] != sorted(counted):
            outcome.findings.append("the repeats are not in order")
        files = list(self._services.recordings.glob(f"{self._spec.id}*.mcap"))
        outcome.bytes = sum(path.stat().st_size for path in files)
        outcome.forecast_bytes = self._forecast_bytes()
        for recording in volumes(self._services, self._spec.id):
            outcome.recordings += 1
            result = self._services.bus.query(
                self._keys.recording_verify(recording), recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult
            )
            outcome.findings += [f"{recording}: {finding}" for finding in result.findings]
        outcome.findings += self._services.defects()


def repeat_of(run: str) -> int:
    """Return the repeat that a run is of."""
    return int(run.rpartition(".r")[2].partition("-")[0])


def volumes(services: KillableServices, id: str) -> list[str]:
    """Return the ids of the recordings of an endurance test, in order."""
    known = {path.name.partition(".")[0] for path in services.recordings.glob(f"{id}*.mcap")}
    return sorted(known, key=lambda name: (len(name) > len(id), name))


def recorded_steps(services: KillableServices, id: str) -> Iterator[object]:
    """Yield the steps of all recordings of an endurance test."""
    bus = services.bus
    for recording in volumes(services, id):
        first, total = 0, 1
        while first < total:
            answer = bus.query(
                bus.keys.recording_steps(recording),
                recorder_pb2.ReadStepsRequest(first=first),
                recorder_pb2.RecordedSteps,
            )
            for step in answer.steps:
                name = step.message_type.rpartition(".")[2]
                kind = next(
                    getattr(module, name) for module in (sequencer_pb2, recorder_pb2, rig_pb2) if hasattr(module, name)
                )
                yield kind.FromString(step.payload)
            first, total = first + len(answer.steps), answer.total
