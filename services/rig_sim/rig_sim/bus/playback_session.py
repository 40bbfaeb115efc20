"""One playback on the bus: paced, streamed block by block, watched, and ramped down where something trips."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
import structlog

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2
from labbus import Bus, Call, FaultError, SpoolFullError, SpoolSpace, StreamPublisher
from rig_sim.bus.interlock import Interlock
from rig_sim.bus.pose_stream import PoseStream
from rig_sim.playing.playable import PlayableRig, PlayableRun
from rig_sim.playing.playback import Block
from rig_sim.playing.player import Playback, Rig, RigFaultError
from rig_sim.specimen.watchdogs import Trip, WatchdogMonitor

COMMANDER_GONE = "its commander is gone"
_STATE_SECONDS = 0.5
#: Paced in real time, the player is ahead of the clock by a slice; so a stop is heard within one.
_PACED_SECONDS = 0.02
#: A simulation that runs ahead of the clock publishes so many blocks as one: each message costs the bus and the
#: recorder far more than what is in it, and these few milliseconds are not seen. Watched is every block by itself.
_BLOCKS_TOGETHER = 4
_ROOM_POLL_SECONDS = 0.01


def published_samples(rig: PlayableRig) -> int:
    """Return how many samples a full block of the signal stream has; paced in real time it is published in parts.

    Parameters
    ----------
    rig : PlayableRig
        Whose signal stream it is.

    Returns
    -------
    int
        Samples of a block.
    """
    return _BLOCKS_TOGETHER * rig.block_samples


class PlaybackSession:
    """Playbacks of drives on one rig; the interlock admits one at a time.

    Parameters
    ----------
    bus : Bus
        Where signal blocks and poses are published.
    rig : PlayableRig
        The rig that plays.
    interlock : Interlock
        Its latch.
    responses : sequence of array_pb2.Channel
        Response channels of a result, in order.
    report_state : callable
        Publishes the state of the rig.
    spools : SpoolSpace
        Where signal blocks are kept until the recorder has stored them.
    spool_wait_seconds : float
        How long a simulation waits for room in the spool, in s.
    """

    def __init__(
        self,
        bus: Bus,
        rig: PlayableRig,
        interlock: Interlock,
        *,
        responses: Sequence[array_pb2.Channel],
        report_state: Callable[[], None],
        spools: SpoolSpace,
        spool_wait_seconds: float,
    ) -> None:
        self._bus = bus
        self._spools = spools
        self._spool_wait_seconds = spool_wait_seconds
        self._rig = rig
        self._interlock = interlock
        self._monitor = WatchdogMonitor(rig.watchdogs, sample_rate=rig.specimen.sample_rate)
        self._responses = list(responses)
        self._report_state = report_state
        self._poses = PoseStream(bus, rig.specimen.name, rig.poses) if isinstance(rig, Rig) else None
        self._log = structlog.get_logger("rig_sim").bind(rig=rig.specimen.name)

    def play(
        self, request: rig_pb2.PlayRequest, drive: np.ndarray, call: Call, *, real_time: bool
    ) -> rig_pb2.PlayResult:
        """Play a checked drive on a rig that the interlock has given.

        Parameters
        ----------
        request : rig_pb2.PlayRequest
            What was asked.
        drive : (drives, samples)
            Its drive, checked.
        call : Call
            Of the commander: told of progress; when it is gone, the rig ramps down.
        real_time : bool
            Play no faster than real time.

        Returns
        -------
        rig_pb2.PlayResult
            Of a playback that came to its end.

        Raises
        ------
        FaultError
            CANCELLED where it was stopped or its commander went, FAILED_PRECONDITION where a watchdog tripped or the
            rig failed before the drive's end. The rig is latched then.
        """
        playback = self._rig.playback(drive, seed=request.seed)
        rate = self._rig.specimen.sample_rate
        if real_time:
            playback.block_samples = min(playback.block_samples, max(round(_PACED_SECONDS * rate), 1))
        publisher = self._bus.publisher(
            self._bus.keys.rig_signal(self._rig.specimen.name, request.run), spools=self._spools, durable=True
        )
        size = self._rig.block_samples if real_time else published_samples(self._rig)
        publish = _Publishing(publisher, request.run, rate, size=size)
        clock, moved = _Clock(rate, real_time=real_time), False
        if self._poses is not None:
            self._poses.begin(request.run)
        try:
            if shortage := self._lack_of_room(publisher, call, wait=True):
                raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"Nothing was played: {shortage}.")
            moved = True
            self._settle(request.run, playback, clock, call)
            began = time.monotonic()
            self._perform(request.run, playback, publish, clock, call)
            seconds = drive.shape[1] / rate
            factor = seconds / (time.monotonic() - began)
            self._come_to_rest(request.run, playback, clock, call)
        except RigFaultError as error:
            publish.flush(last=False)
            self._latch(str(error).rstrip("."))
            self._log.warning("broken off", run=request.run, reason=str(error))
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="drive.samples") from error
        except Exception as error:
            # By a defect, or because its bus is gone: it is not known to rest. A stop and a trip are latched already.
            if moved and not self._interlock.wait_for_stop(0.0):
                self._latch(f"run {request.run!r} was broken off by a defect ({type(error).__name__}: {error})")
            raise
        finally:
            if self._poses is not None:
                self._poses.flush()
            publisher.close()
        self._log.info("played", run=request.run, seconds=seconds, real_time_factor=factor)
        return self._result(request.run, playback, publish, factor)

    def _result(self, run: str, playback: PlayableRun, publish: _Publishing, factor: float) -> rig_pb2.PlayResult:
        return rig_pb2.PlayResult(
            run=run,
            response=to_record(self._responses, self._rig.specimen.sample_rate, playback.response),
            actuators=[
                rig_pb2.ActuatorUse(
                    drive=use.drive,
                    peak_command_ratio=use.peak_command_ratio,
                    saturated_share=use.saturated_share,
                    largest_following_error=use.largest_following_error,
                    largest_load_pressure_share=use.largest_load_pressure_share,
                    lowest_supply_pressure=use.lowest_supply_pressure,
                )
                for use in playback.uses()
            ],
            epoch=publish.publisher.epoch,
            blocks=publish.blocks,
            real_time_factor=factor,
        )

    def _settle(self, run: str, playback: PlayableRun, clock: _Clock, call: Call) -> None:
        """Bring the rig to the drive's first sample; its way there is watched, and no part of the stream."""
        for block in playback.approach():
            stopped = self._interlock.wait_for_stop(clock.ahead(block))
            trip = self._watch(block)
            if trip is not None or stopped or call.cancelled:
                self._break_off(run, playback, None, clock, "" if trip is None else trip.sentence)
            call.progress("settling", 0.0, detail=run)

    def _perform(self, run: str, playback: PlayableRun, publish: _Publishing, clock: _Clock, call: Call) -> None:
        self._interlock.enter(rig_pb2.RIG_MODE_PLAYING)
        self._report_state()
        samples = playback.response.shape[1]
        began = told = time.monotonic()
        for block in playback.blocks():
            done = playback.samples_done
            stopped = self._interlock.wait_for_stop(clock.ahead(block))
            trip = self._watch(block)
            ended = done == samples and trip is None
            publish(block, last=ended)
            self._show(playback)
            if ended and not publish.refusal:
                return
            shortage = publish.refusal or self._lack_of_room(publish.publisher, call, wait=not clock.real_time)
            if trip is not None or stopped or call.cancelled or shortage:
                self._break_off(run, playback, publish, clock, shortage if trip is None else trip.sentence)
            now = time.monotonic()
            self._interlock.fraction = done / samples
            # The bus thins progress out; the state stream goes to everybody.
            left = (now - began) * (samples - done) / done
            call.progress("playing", done / samples, remaining_seconds=left, detail=run)
            if now - told >= _STATE_SECONDS:
                told = now
                self._report_state()

    def _come_to_rest(self, run: str, playback: PlayableRun, clock: _Clock, call: Call) -> None:
        """Bring the rig back to zero after a drive that ended elsewhere; all of it was played, whatever happens now."""
        if playback.rests_at_zero:
            return
        self._interlock.fraction = 1.0
        self._interlock.enter(rig_pb2.RIG_MODE_RAMPING_DOWN)
        self._report_state()
        try:
            for block in playback.ramp_down():
                time.sleep(clock.ahead(block))
                if (trip := self._watch(block)) is not None:
                    self._latch(trip.sentence)
                call.progress("ramping down", 1.0, detail=run)
        except RigFaultError as error:
            self._latch(str(error).rstrip("."))
            self._log.warning("failed on its way to rest", run=run, reason=str(error))

    def _lack_of_room(self, publisher: StreamPublisher, call: Call, *, wait: bool) -> str:
        """Wait until what is played next can be kept for the recorder; return why it cannot, or an empty text.

        A rig in real time cannot wait; a simulation stands still meanwhile.
        """
        deadline = time.monotonic() + (self._spool_wait_seconds if wait else 0.0)
        while shortage := publisher.shortage:
            if time.monotonic() >= deadline:
                return f"{shortage}, the recorder has not stored {publisher.unmarked} blocks; see to the recorder"
            if self._interlock.wait_for_stop(_ROOM_POLL_SECONDS) or call.cancelled:
                break
        return ""

    def _watch(self, block: Block) -> Trip | None:
        return self._monitor.first_trip(
            first_sample=block.first_sample,
            response=block.response,
            following_error=block.following_error,
            monitored=block.monitored,
        )

    def _break_off(
        self, run: str, playback: PlayableRun, publish: _Publishing | None, clock: _Clock, trouble: str
    ) -> None:
        """Latch, ramp down and raise what the commander is told; published is what follows a drive that has begun.

        `trouble` is what the rig itself found, empty where it was stopped or its commander went.
        """
        # Where it was stopped, it is latched already; a reset that waits for the rest is to find no other trip.
        if trouble or not self._interlock.wait_for_stop(0.0):
            self._latch(trouble or COMMANDER_GONE)
        reason = self._interlock.state().reason
        if publish is not None:
            publish.flush(last=False)
        ramp = playback.ramp_down()
        block = next(ramp, None)
        while block is not None:
            # One ahead: only who has seen the next knows whether this is the last.
            following = next(ramp, None)
            time.sleep(clock.ahead(block))
            if publish is not None:
                publish(block, last=following is None)
            block = following
        self._log.warning("ramped down", run=run, reason=reason)
        if publish is not None and publish.refusal:
            self._log.error("the end of a run is not published", run=run, reason=publish.refusal)
        if not trouble:
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"run {run!r} was stopped: {reason}.")
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"run {run!r} was broken off: {trouble}; see to it and reset {self._rig.specimen.name}.",
            field="drive.samples",
        )

    def _latch(self, reason: str) -> None:
        self._interlock.trip(reason)
        self._report_state()

    def _show(self, playback: PlayableRun) -> None:
        if self._poses is not None and isinstance(playback, Playback):
            self._poses.add(playback.samples_done / self._rig.specimen.sample_rate, playback.positions)


class _Publishing:
    """Publishes the blocks of one run, slices of a block together, and counts them."""

    def __init__(self, publisher: StreamPublisher, run: str, rate: float, *, size: int) -> None:
        self.publisher = publisher
        self._run = run
        self._rate = rate
        self._size = size
        self._slices: list[Block] = []
        self.blocks = 0
        self.refusal = ""
        """Why a block could not be published; it goes out with the next one."""

    def __call__(self, block: Block, *, last: bool) -> None:
        self._slices.append(block)
        if last or sum(part.drive.shape[1] for part in self._slices) >= self._size:
            self.flush(last=last)

    def flush(self, *, last: bool) -> None:
        """Publish what was gathered."""
        if not self._slices:
            return
        block = rig_pb2.SignalBlock(
            run=self._run,
            first_sample=self._slices[0].first_sample,
            sample_rate=self._rate,
            drive=to_array(np.hstack([part.drive for part in self._slices])),
            response=to_array(np.hstack([part.response for part in self._slices])),
            last=last,
        )
        try:
            self.publisher.put(block)
        except SpoolFullError as error:
            self.refusal = str(error).rstrip(".")
            return
        self.refusal = ""
        self.blocks += 1
        self._slices.clear()


class _Clock:
    """Says how far a playback is ahead of real time, where it has to keep to it; runs from its first block on."""

    def __init__(self, rate: float, *, real_time: bool) -> None:
        self._rate = rate
        self.real_time = real_time
        self._origin: int | None = None
        self._started = 0.0

    def ahead(self, block: Block) -> float:
        """Return for how many seconds to wait at the end of a block."""
        if not self.real_time:
            return 0.0
        if self._origin is None:
            self._origin, self._started = block.first_sample, time.monotonic()
        return max((block.end - self._origin) / self._rate - (time.monotonic() - self._started), 0.0)
