"""Playback on the bus: paced, streamed block by block, monitored, and ramped down after a trip."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import structlog

from duralab_bus import Bus, Call, FaultError, SpanKind, SpoolSpace, StreamPublisher, spans
from duralab_gateway.interlock import Interlock
from duralab_gateway.motion import Block, DrivePlayback, Level, RigFaultError, WatchdogMonitor
from duralab_gateway.publishing import BlockPublisher, Clock, PoseStream
from duralab_gateway.rig import KnowsMore, Phase, PlaybackRig, Run, RunEndedError
from duralab_proto.arrays import to_record
from duralab_proto.v1 import query_pb2, rig_pb2

COMMANDER_GONE = "its commander is gone"
_STATE_SECONDS = 0.5
#: As often as the bus sends progress; a rig that plays fast has thousands of blocks a second.
_PROGRESS_SECONDS = 0.05
#: Paced in real time, the player is ahead of the clock by a slice; so a stop is noticed within one.
_PACED_SECONDS = 0.02
_ROOM_POLL_SECONDS = 0.01


class PlaybackSession:
    """Playbacks of drives on one rig; the interlock admits one at a time.

    `latch` latches the rig for a reason and publishes its state. A simulation waits `spool_wait_seconds` for room in
    the spool, where signal blocks are kept until the recorder has stored them.
    """

    def __init__(
        self,
        bus: Bus,
        rig: PlaybackRig,
        description: rig_pb2.RigDescription,
        interlock: Interlock,
        *,
        latch: Callable[[str], None],
        report_state: Callable[[], None],
        spools: SpoolSpace,
        spool_wait_seconds: float,
    ) -> None:
        self._bus = bus
        self._spools = spools
        self._spool_wait_seconds = spool_wait_seconds
        self._rig = rig
        self._description = description
        self._name, self._rate = description.rig, description.sample_rate
        self._goes_on = description.cannot_be_stopped
        self._interlock = interlock
        ending = [dog for dog in rig.watchdogs if dog.level is not Level.WARNING]
        self._monitor = WatchdogMonitor(ending, sample_rate=self._rate)
        # One monitor for each level: every response is reported once a run, independent of the others.
        self._warning_monitors = [
            WatchdogMonitor([dog], sample_rate=self._rate) for dog in rig.watchdogs if dog.level is Level.WARNING
        ]
        self._unwarned: list[WatchdogMonitor] = []
        self._warnings: list[str] = []
        self._latch = latch
        self._report_state = report_state
        self._poses = PoseStream(bus, self._name) if description.bodies else None
        self._log = structlog.get_logger("rig_sim").bind(rig=self._name)

    def play(
        self, request: rig_pb2.PlayRequest, drive: np.ndarray, call: Call, *, real_time: bool
    ) -> rig_pb2.PlayResult:
        """Play a checked drive on a rig that the interlock has reserved."""
        run = Run(
            request.run,
            seed=request.seed,
            real_time=real_time,
            report=lambda sentence, fraction: self._report(call, request.run, sentence, fraction),
            stopping=lambda seconds: self._must_end(call, seconds),
            waiting=self._wait_for,
        )
        try:
            playback = self._rig.playback(drive, run)
        except RigFaultError as error:
            self._latch(str(error).rstrip("."))
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"Nothing was played: {error}") from error
        rate, limit = self._rate, self._description.block_samples
        size = self._message_samples(playback, real_time=real_time)
        publisher = self._bus.publisher(
            self._bus.keys.rig_signal(self._name, request.run), spools=self._spools, durable=True
        )
        hold = self._description.publishes_after_run
        publish = BlockPublisher(publisher, request.run, rate, size=size, limit=limit, hold=hold)
        clock, moved = Clock(rate, real_time=real_time and playback.is_paced), False
        self._unwarned, self._warnings = list(self._warning_monitors), []
        if self._poses is not None:
            self._poses.begin(request.run)
        try:
            if shortage := self._lack_of_room(publisher, call, wait=True):
                raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"Nothing was played: {shortage}.")
            moved = True
            self._settle(run, playback, clock, call)
            began = time.monotonic()
            self._perform(run, playback, publish, clock, call)
            seconds = drive.shape[1] / rate
            factor = seconds / (time.monotonic() - began)
            self._come_to_rest(run, playback, clock, call)
        except RunEndedError as error:
            self._log.info("ended before anything moved", run=request.run, reason=error.message)
            raise
        except RigFaultError as error:
            publish.flush(last=False)
            self._latch(str(error).rstrip("."))
            self._log.warning("broken off", run=request.run, reason=str(error))
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="drive.samples") from error
        except Exception as error:
            # After a defect, or a closed bus, it is not known whether the rig rests. A stop and a trip are latched
            # already.
            if moved and not self._interlock.wait_for_stop(0.0):
                self._latch(f"run {request.run!r} was broken off by a defect ({type(error).__name__}: {error})")
            raise
        finally:
            if self._poses is not None:
                self._poses.flush()
            publisher.close()
            if moved:
                self._end(request.run, playback)
        self._log.info("played", run=request.run, seconds=seconds, real_time_factor=factor)
        return self._result(request.run, playback, publish, factor)

    def _message_samples(self, playback: DrivePlayback, *, real_time: bool) -> int:
        """Set the length of a playback's blocks; return the number of samples that are published together."""
        limit = self._description.block_samples
        if real_time:
            size = min(playback.block_samples, limit)
            playback.cut(_PACED_SECONDS)
            return size
        # Faster than real time, blocks are published together, and played together if the rig can: each costs the
        # player, the bus and the recorder far more than its content, and these few milliseconds are not visible.
        playback.play_ahead(limit, self._monitor.first_trip)
        return limit

    def _end(self, run: str, playback: DrivePlayback) -> None:
        try:
            playback.end()
        except RigFaultError as error:
            self._latch(str(error).rstrip("."))
            self._log.exception("a run could not be ended", run=run)
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error

    def _result(self, run: str, playback: DrivePlayback, publish: BlockPublisher, factor: float) -> rig_pb2.PlayResult:
        result = rig_pb2.PlayResult(
            run=run,
            response=to_record(list(self._description.responses), self._rate, playback.response),
            actuators=[rig_pb2.ActuatorUse(**asdict(use)) for use in playback.uses()],
            epoch=publish.publisher.epoch,
            blocks=publish.blocks,
            real_time_factor=factor,
            warnings=self._warnings,
        )
        if isinstance(playback, KnowsMore):
            playback.complete(result)
        return result

    def _settle(self, run: Run, playback: DrivePlayback, clock: Clock, call: Call) -> None:
        """Bring the rig to the drive's first sample; its approach is monitored, and is not part of the stream."""
        for block in spans(playback.approach(), "approach the first sample", SpanKind.PLAYBACK):
            ends = run.wait_for_stop(clock.ahead(block))
            trip = self._watch(block)
            if trip or ends:
                self._break_off(run, playback, None, clock, trip)
            call.progress("settling", 0.0, detail=run.name)

    def _perform(self, run: Run, playback: DrivePlayback, publish: BlockPublisher, clock: Clock, call: Call) -> None:
        run.phase = Phase.PLAYING
        self._interlock.enter(rig_pb2.RIG_MODE_PLAYING)
        self._report_state()
        samples = playback.response.shape[1]
        began = reported = time.monotonic()
        told = 0.0
        for block in spans(playback.blocks(), "play a block", SpanKind.PLAYBACK):
            done = playback.samples_done
            ends = run.wait_for_stop(clock.ahead(block))
            trip = self._watch(block)
            ended = done == samples and not trip
            publish(block, last=ended)
            if self._poses is not None:
                self._poses.add(playback.instants(), self._rate, playback.frames)
            if ended and not publish.refusal:
                return
            shortage = publish.refusal or self._lack_of_room(publish.publisher, call, wait=not clock.real_time)
            if trip or ends or (shortage and (ended or not self._goes_on)):
                self._break_off(run, playback, publish, clock, trip or shortage)
            now = time.monotonic()
            self._interlock.fraction = done / samples
            # The state stream is public, the progress is the commander's.
            if now - told >= _PROGRESS_SECONDS:
                told = now
                left = (now - began) * (samples - done) / done
                call.progress("playing", done / samples, remaining_seconds=left, detail=run.name)
            if now - reported >= _STATE_SECONDS:
                reported = now
                self._report_state()

    def _come_to_rest(self, run: Run, playback: DrivePlayback, clock: Clock, call: Call) -> None:
        """Bring the rig back to zero after a drive with another end; a failure now does not affect the played drive."""
        if playback.rests_at_zero:
            return
        run.phase = Phase.RAMPING_DOWN
        self._interlock.fraction = 1.0
        self._interlock.enter(rig_pb2.RIG_MODE_RAMPING_DOWN)
        self._report_state()
        try:
            for block in playback.ramp_down():
                time.sleep(clock.ahead(block))
                if trip := self._watch(block):
                    self._latch(trip)
                call.progress("ramping down", 1.0, detail=run.name)
        except RigFaultError as error:
            self._latch(str(error).rstrip("."))
            self._log.warning("failed on its way to rest", run=run.name, reason=str(error))

    def _lack_of_room(self, publisher: StreamPublisher, call: Call, *, wait: bool) -> str:
        """Wait until the next blocks can be kept for the recorder; return why they cannot, or an empty string.

        A rig in real time cannot wait; a simulation pauses meanwhile.
        """
        deadline = time.monotonic() + (self._spool_wait_seconds if wait else 0.0)
        while shortage := publisher.shortage:
            if time.monotonic() >= deadline:
                return f"{shortage}, the recorder has not stored {publisher.unmarked} blocks; see to the recorder"
            if self._must_end(call, _ROOM_POLL_SECONDS):
                break
        return ""

    def _wait_for(self, sentence: str) -> None:
        if self._interlock.enter(rig_pb2.RIG_MODE_WAITING, awaited=sentence):
            self._report_state()

    def _report(self, call: Call, run: str, sentence: str, fraction: float | None) -> None:
        if fraction is not None:
            self._interlock.fraction = fraction
        call.progress(sentence, self._interlock.fraction, detail=run)

    def _must_end(self, call: Call, seconds: float) -> bool:
        """Wait for at most `seconds`, or until a stop; return whether a stop or a lost commander ends the run."""
        if self._goes_on:
            time.sleep(seconds)
            return False
        return self._interlock.wait_for_stop(seconds) or call.cancelled

    def _watch(self, block: Block) -> str:
        """Return the trip of a watchdog that ends the run; a run that cannot be stopped only latches."""
        for monitor in tuple(self._unwarned):
            if (crossed := monitor.first_trip(block)) is not None:
                self._unwarned.remove(monitor)
                sentence = f"{crossed.sentence[:1].upper()}{crossed.sentence[1:]}."
                self._warnings.append(sentence)
                self._log.warning("warning level crossed", channel=crossed.watchdog.name, what=sentence)
        trip = self._monitor.first_trip(block)
        if trip is None:
            return ""
        if not self._goes_on:
            return trip.sentence
        if not self._interlock.wait_for_stop(0.0):
            self._latch(trip.sentence)
        return ""

    def _break_off(
        self, run: Run, playback: DrivePlayback, publish: BlockPublisher | None, clock: Clock, trouble: str
    ) -> None:
        """Latch, ramp down and raise the commander's fault; the ramp is published if the drive has begun.

        `trouble` is the rig's own finding, empty if it was stopped or its commander was lost.
        """
        # A stopped rig is latched already; a reset that waits for the rest must not find another trip.
        if trouble or not self._interlock.wait_for_stop(0.0):
            self._latch(trouble or COMMANDER_GONE)
        reason = self._interlock.state().reason
        run.phase = Phase.RAMPING_DOWN
        if publish is not None:
            publish.flush(last=False)
        ramp = playback.ramp_down()
        block = next(ramp, None)
        while block is not None:
            # One block ahead: only the next block shows whether this one is the last.
            following = next(ramp, None)
            time.sleep(clock.ahead(block))
            if publish is not None:
                publish(block, last=following is None)
            block = following
        self._log.warning("ramped down", run=run.name, reason=reason)
        if publish is not None and publish.refusal:
            self._log.error("the end of a run is not published", run=run.name, reason=publish.refusal)
        if not trouble:
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"run {run.name!r} was stopped: {reason}.")
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"run {run.name!r} was broken off: {trouble}; see to it and reset {self._name}.",
            field="drive.samples",
        )
