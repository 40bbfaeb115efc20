"""Sequencer on the bus: starts endurance tests, reports their status, holds, resumes and stops them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Annotated, Final, Self

import structlog
from pydantic import Field

from duralab_bus import (
    Admissions,
    Admitted,
    Bus,
    BusError,
    Call,
    FaultError,
    ServiceConfig,
    SpoolFullError,
    SpoolSpace,
    already_exists,
    described_rig,
)
from duralab_proto.keys import ANY, id_of
from duralab_proto.v1 import query_pb2, sequencer_pb2
from sequencer.channel_figures import CHANNEL_FIGURES
from sequencer.endurance import (
    EnduranceBoard,
    EndurancePlan,
    EnduranceTest,
    Progress,
    column_names,
    fresh_progress,
    go_on_recording,
    is_final,
    last_volume,
    plan_endurance,
    read_endurance,
    recorded_progress,
    require_names,
    require_open,
    require_same_rig,
)
from sequencer.kept_samples import HeldFiles

SERVICE: Final = "sequencer"
"""Name of the service, as in its liveliness key."""

# Longest wait of a stop for the end of the test before it answers with the status.
_STOP_SECONDS: Final = 8.0
# Number of ended tests whose status is kept; the recorder has the older ones.
_KEPT_STATUSES: Final = 20
# The process must end within 3 s of the request, with or without its tests.
_CLOSE_SECONDS: Final = 1.5
# Spool of the events of all tests for subscribers that missed one, an eighth of it for each test: those of the last
# minute. Losing an older event loses nothing, because the next event contains all its data.
_EVENT_BYTES: Final = 16 * 1024 * 1024


class SequencerConfig(ServiceConfig):
    """Configuration of the sequencer."""

    # A test continues in another recording after this number of repeats, which bounds a service's data of a recording.
    repeats_per_recording: Annotated[int, Field(ge=1, le=100_000)] = 1000
    # Folder of the last repeats, which an alarm may require; without it, a crash of the sequencer loses their samples.
    held_folder: Path | None = None


class SequencerService:
    """Manages the endurance tests of this process, one at a time on each rig; interrupts them on exit of the context.

    `bus`: Bus whose keys are served from the start.
    """

    def __init__(self, bus: Bus, config: SequencerConfig) -> None:
        self._bus = bus
        self._config = config
        self._tests = Admissions[EnduranceTest, sequencer_pb2.EnduranceStatus]("endurance test", kept=_KEPT_STATUSES)
        self._spools = SpoolSpace(_EVENT_BYTES)
        self._register_metrics()
        keys = bus.keys
        bus.serve(keys.endurance_start(ANY), sequencer_pb2.EnduranceSpec, self.start)
        bus.serve(keys.endurance(ANY), sequencer_pb2.EnduranceRequest, self.status)
        # Separate workers: a stop must not wait for other requests.
        bus.serve(keys.endurance_stop(ANY), sequencer_pb2.StopEnduranceRequest, self.stop, workers=4)
        bus.serve(keys.endurance_hold(ANY), sequencer_pb2.HoldEnduranceRequest, self.hold, workers=4)
        bus.serve(keys.endurance_resume(ANY, ANY), sequencer_pb2.ResumeEnduranceRequest, self.resume)
        bus.serve(keys.endurance_decide(ANY, ANY), sequencer_pb2.EnduranceDecision, self.decide)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        running = self._tests.running()
        for entry in running:
            if entry.work is not None:
                entry.work.leave()
        until = time.monotonic() + _CLOSE_SECONDS
        for entry in running:
            entry.board.wait_ended(max(0.0, until - time.monotonic()))

    def start(self, spec: sequencer_pb2.EnduranceSpec, call: Call) -> sequencer_pb2.EnduranceStatus:
        """Check an endurance test and start it; answer at once."""
        require_names(spec)
        call.require_rig(spec.rig, field="rig")
        with self._tests.admitting(spec.id, spec.rig):
            call.progress("checking", 0.0, detail=f"endurance test {spec.id}")
            if last_volume(self._bus, spec.id):
                raise already_exists(spec.id)
            plan = plan_endurance(spec, described_rig(self._bus, spec.rig))
            return self._begin(plan, fresh_progress(plan))

    def resume(self, request: sequencer_pb2.ResumeEnduranceRequest, call: Call) -> sequencer_pb2.EnduranceStatus:
        """Continue after a hold by a person or a fault, or after a crash of the sequencer; answer at once."""
        del request
        id = id_of(call.key)
        entry = self._tests.get(id)
        if entry is not None and entry.work is not None:
            call.require_rig(entry.work.rig, field="rig")
            entry.work.resume(call)
            return entry.board.snapshot()
        call.progress("reading back", 0.0, detail=f"endurance test {id}")
        recorded = read_endurance(self._bus, id)
        call.require_rig(recorded.spec.rig, field="rig")
        require_open(self._bus, recorded)
        with self._tests.admitting(id, recorded.spec.rig, again=True):
            description = described_rig(self._bus, recorded.spec.rig)
            require_same_rig(recorded, description)
            # Read again: only now no other request can continue it.
            recorded = read_endurance(self._bus, id)
            require_open(self._bus, recorded)
            go_on_recording(self._bus, recorded)
            plan = plan_endurance(recorded.spec, description)
            return self._begin(plan, recorded_progress(recorded, plan))

    def _begin(self, plan: EndurancePlan, before: Progress) -> sequencer_pb2.EnduranceStatus:
        spec = plan.spec
        board = EnduranceBoard(
            sequencer_pb2.EnduranceStatus(
                id=spec.id,
                rig=spec.rig,
                phase=sequencer_pb2.ENDURANCE_PHASE_CHECKING,
                activity="starting",
                repeats=len(plan.sequence),
                played=before.next_repeat,
                remaining_seconds=-1.0,
                responses=plan.responses,
                columns=column_names(plan.schedule.monitoring),
                alarms=before.alarms,
                kept=before.kept,
            ),
            publish=self._publishing(spec.id),
        )
        test = EnduranceTest(
            plan,
            before,
            bus=self._bus,
            board=board,
            repeats_per_volume=self._config.repeats_per_recording,
            held_files=self._held_files(spec.id),
            on_end=lambda: self._tests.end(spec.id, spec.rig),
        )
        self._tests.begin(spec.id, test, board)
        structlog.get_logger(SERVICE).info(
            "endurance test accepted", endurance_test=spec.id, rig=spec.rig, next_repeat=before.next_repeat
        )
        test.start()
        return board.snapshot()

    def _held_files(self, id: str) -> HeldFiles | None:
        folder, journal = self._config.held_folder, structlog.get_logger(SERVICE)
        return None if folder is None else HeldFiles(folder / id, warn=journal.warning)

    def status(self, request: sequencer_pb2.EnduranceRequest, call: Call) -> sequencer_pb2.EnduranceStatus:
        """Return the status of an endurance test."""
        del request
        return self._entry(id_of(call.key)).board.snapshot()

    def stop(self, request: sequencer_pb2.StopEnduranceRequest, call: Call) -> sequencer_pb2.EnduranceStatus:
        """End a test, and stop and latch its rig in any state; one that has ended stays unchanged."""
        entry = self._entry(id_of(call.key))
        if entry.work is not None:
            entry.work.stop(request.reason or "no reason was given")
            call.progress("stopping", 0.0)
            entry.board.wait_ended(_STOP_SECONDS)
        return entry.board.snapshot()

    def hold(self, request: sequencer_pb2.HoldEnduranceRequest, call: Call) -> sequencer_pb2.EnduranceStatus:
        """Hold a test after the current repeat."""
        entry = self._entry(id_of(call.key))
        self._running_test(entry, call).hold(request.reason or "no reason was given")
        return entry.board.snapshot()

    def decide(self, request: sequencer_pb2.EnduranceDecision, call: Call) -> sequencer_pb2.EnduranceStatus:
        """Apply a person's decision on a hold; answer when it is stored."""
        entry = self._entry(id_of(call.key))
        test = self._running_test(entry, call)
        call.require_rig(test.rig, field="rig")
        test.decide(request, call)
        return entry.board.snapshot()

    @staticmethod
    def _running_test(entry: Admitted[EnduranceTest, sequencer_pb2.EnduranceStatus], call: Call) -> EnduranceTest:
        if entry.work is None:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"Endurance test {id_of(call.key)!r} has ended.", field="id"
            )
        return entry.work

    def _entry(self, id: str) -> Admitted[EnduranceTest, sequencer_pb2.EnduranceStatus]:
        entry = self._tests.get(id)
        if entry is None:
            raise FaultError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"No endurance test {id!r} was started or resumed since the sequencer began; resume it if it has not "
                "ended.",
                field="id",
            )
        return entry

    def _publishing(self, id: str) -> Callable[[sequencer_pb2.EnduranceStatus], None]:
        publisher = self._bus.publisher(self._bus.keys.endurance_event(id), spools=self._spools)

        def publish(status: sequencer_pb2.EnduranceStatus) -> None:
            try:
                publisher.put(sequencer_pb2.EnduranceEvent(status=status))
            except (BusError, SpoolFullError) as error:
                # Clients may query the status; the test continues.
                structlog.get_logger(SERVICE).warning("An event was not published.", test=id, why=str(error))
            if is_final(status):
                publisher.close()

        return publish

    def _register_metrics(self) -> None:
        """Register the metrics of the running tests."""
        readings: tuple[tuple[str, str, Callable[[sequencer_pb2.EnduranceStatus], float]], ...] = (
            ("repeats", "Repeats of the schedule", lambda status: status.repeats),
            ("played", "Repeats counted as played", lambda status: status.played),
            ("unknown", "Repeats counted as played whose end is not known", lambda status: status.unknown),
            (
                "correction_playbacks",
                "Playbacks of campaigns that corrected a drive",
                lambda status: status.correction_playbacks,
            ),
            ("alarms", "Alarms so far", lambda status: status.alarms),
            ("kept", "Repeats recorded with all samples", lambda status: status.kept),
            (
                "holding",
                "Whether it waits for a person",
                lambda status: status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING,
            ),
            ("remaining_seconds", "Expected time to the end; negative where unknown", lambda s: s.remaining_seconds),
        )
        for name, what, read in readings:
            self._bus.metrics.follow(
                f"duralab_endurance_{name}",
                what,
                lambda read=read: self._by_test(read),
                labels=("test",),
            )
        for name, (what, of_channels) in CHANNEL_FIGURES.items():
            self._bus.metrics.follow(
                f"duralab_endurance_{name}",
                what,
                lambda read=of_channels: self._by_channel(read),
                labels=("test", "channel"),
            )

    def _by_test(self, read: Callable[[sequencer_pb2.EnduranceStatus], float]) -> Mapping[tuple[str, ...], float]:
        return {(status.id,): float(read(status)) for status in self._running()}

    def _by_channel(
        self, read: Callable[[sequencer_pb2.EnduranceStatus], Mapping[str, float]]
    ) -> Mapping[tuple[str, ...], float]:
        return {(status.id, name): value for status in self._running() for name, value in read(status).items()}

    def _running(self) -> list[sequencer_pb2.EnduranceStatus]:
        return [entry.board.snapshot() for entry in self._tests.running()]


def build(config: SequencerConfig) -> Callable[[Bus], AbstractContextManager[object]]:
    """Return a function that starts the sequencer on a bus.

    Parameters
    ----------
    config : SequencerConfig
        Checked configuration.

    Returns
    -------
    callable
        Takes the bus; returns the context of the running service.
    """
    return lambda bus: SequencerService(bus, config)
