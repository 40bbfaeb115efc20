"""Checks of stop, latch and reset with a gentle playback in real time that is stopped halfway."""

from __future__ import annotations

import threading
import time

import numpy as np

from duralab.conformance.bench import PATIENCE_SECONDS, REPAIR_SECONDS, Bench, BreachError, NotTriedError, expect
from duralab.conformance.play_checks import Pulse, check_signal
from duralab.conformance.refusal_checks import check_refused, gentle_drive
from duralab_bus import BusError, FaultError
from duralab_proto.arrays import from_array, from_record
from duralab_proto.v1 import query_pb2, rig_pb2

REASON = "conformance check"
#: Tolerance of a drive at the end of a ramp down, as a share of its limits.
_AT_ZERO = 1.0e-3
_STOP_AT = 0.4


#: Shortest time of a whole playback in real time, as a share of its drive's length.
_WHOLE = 0.9


class StopChecks:
    """Checks of a playback that is stopped, or continues to its end if the description states `cannot_be_stopped`."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._run = bench.new_run()
        self._outcome: FaultError | rig_pb2.PlayResult | None = None
        self._playing: threading.Thread | None = None
        self._stopped = False
        self._late = False
        self._drive = np.zeros((0, 0))
        self._too_slow = (
            f"this process was too slow to stop a drive of {bench.seconds:g} s before its end; check again with less "
            "load on this machine."
        )

    def check_busy_and_stops(self) -> None:
        """Check that a playing rig refuses another drive, and that a stop latches it with the reason."""
        with Pulse() as pulse:
            try:
                self._check_busy_and_stops(pulse)
            except BreachError:
                if pulse.longest_pause >= (_WHOLE - _STOP_AT) * self._bench.seconds:
                    raise NotTriedError(self._too_slow) from None
                raise

    def _check_busy_and_stops(self, pulse: Pulse) -> None:
        bench = self._bench
        self._drive = drive = gentle_drive(bench.description, bench.seconds)
        self._playing = threading.Thread(target=self._play, daemon=True)
        self._playing.start()
        began = self._wait_until_it_plays()
        expect(self._outcome is None, "the playback had ended before it could be stopped.")
        other = bench.new_run()
        busy: Exception | None = None
        try:
            check_refused(
                bench,
                lambda: bench.play(other, np.zeros((len(drive), 10))),
                run=other,
                code=query_pb2.FAULT_CODE_BUSY,
                field="",
                why="a second drive while one plays",
            )
        except Exception as error:  # noqa: BLE001 - after any error the rig is stopped first
            busy = error
        # A pause of this process may have hidden the moment when the drive began.
        self._late = time.monotonic() - began + pulse.longest_pause >= _WHOLE * bench.seconds
        state = bench.stop(REASON)
        answered = time.monotonic() - began
        self._stopped = True
        self._playing.join(PATIENCE_SECONDS + (bench.seconds if bench.description.cannot_be_stopped else 0.0))
        if busy is not None:
            raise busy
        expect(
            state.mode == rig_pb2.RIG_MODE_INTERLOCKED,
            f"a stop is answered with {rig_pb2.RigMode.Name(state.mode)} instead of RIG_MODE_INTERLOCKED.",
        )
        expect(state.reason == REASON, f"the latch has the reason {state.reason!r}; the stop said {REASON!r}.")
        if bench.description.cannot_be_stopped:
            # A cancelled playback is at rest; `check_ends_cancelled` reports it.
            expect(
                isinstance(self._outcome, FaultError) or state.run == self._run or answered >= _WHOLE * bench.seconds,
                f"a stop was answered {answered:.1f} s after the drive of {bench.seconds:g} s began as if the rig "
                f"rested, and it cannot be stopped; name the run that goes on, {self._run!r}.",
            )
        else:
            expect(
                not state.run,
                f"a stop was answered while run {state.run!r} still plays; answer when it rests, or say "
                "cannot_be_stopped in the description.",
            )

    def check_ends_cancelled(self) -> None:
        """Check that the playback ends with CANCELLED, or with its result if it cannot be stopped."""
        self._need()
        expect(self._outcome is not None, "the stopped playback was never answered.")
        if self._bench.description.cannot_be_stopped:
            self._check_goes_on()
            return
        if self._late and not isinstance(self._outcome, FaultError):
            raise NotTriedError(self._too_slow)
        ended = self._outcome.code_name if isinstance(self._outcome, FaultError) else "a result"
        expect(ended == "CANCELLED", f"the stopped playback was answered with {ended} instead of CANCELLED.")

    def _check_goes_on(self) -> None:
        """Check that a playback that cannot be stopped was played to its end and answered."""
        if isinstance(self._outcome, FaultError):
            ended = f"{self._outcome.code_name}: {self._outcome.message}"
            expect(False, f"a playback that cannot be stopped ended with {ended}; answer it with its result.")
        elif self._outcome is not None:
            samples = from_record(self._outcome.response, field="response")[2].shape[1]
            expect(
                samples == self._drive.shape[1],
                f"a playback that cannot be stopped has {samples} samples; its drive has {self._drive.shape[1]}.",
            )

    def check_ramps_down(self) -> None:
        """Check that the signal blocks are complete, and that all drives end at zero without a jump."""
        self._need()
        bench, description = self._bench, self._bench.description
        modes = bench.modes()
        if (rig_pb2.RIG_MODE_WAITING, self._run) in modes and (rig_pb2.RIG_MODE_PLAYING, self._run) not in modes:
            raise NotTriedError("the run was stopped while it waited for its controller: nothing moved here.")
        bench.wait(lambda: any(item.message.last for item in bench.blocks_of(self._run)), REPAIR_SECONDS)
        check_signal(bench, self._run, epoch=None)
        drive = np.hstack([from_array(item.message.drive) for item in bench.blocks_of(self._run)])
        for channel, row in zip(description.drives, drive, strict=True):
            size = max(channel.maximum, -channel.minimum)
            expect(
                abs(row[-1]) <= _AT_ZERO * size,
                f"after the stop drive {channel.name!r} is left at {row[-1]:.4g} {channel.unit}; it must ramp to 0.",
            )
            fastest = float(np.max(np.abs(np.diff(row, prepend=0.0)))) * description.sample_rate
            expect(
                channel.slew_limit == 0.0 or fastest <= channel.slew_limit,
                f"after the stop drive {channel.name!r} moves at {fastest:.4g} {channel.unit}/s; "
                f"{channel.slew_limit:g} is its limit.",
            )

    def check_state(self) -> None:
        """Check that the state stream reported the latch with the reason."""
        self._need()
        bench = self._bench

        def interlocked() -> bool:
            return any(
                item.message.mode == rig_pb2.RIG_MODE_INTERLOCKED and item.message.reason == REASON
                for item in list(bench.states)
            )

        bench.wait(interlocked)
        expect(interlocked(), "the state stream never said that it is interlocked, with the reason.")
        state = bench.state()
        expect(
            state.mode == rig_pb2.RIG_MODE_INTERLOCKED,
            f"after the stop the rig is {rig_pb2.RigMode.Name(state.mode)}; the latch must stay until a reset.",
        )

    def check_refuses(self) -> None:
        """Check that the latched rig refuses to play."""
        self._need()
        bench, run = self._bench, self._bench.new_run()
        check_refused(
            bench,
            lambda: bench.play(run, np.zeros((len(bench.description.drives), 10))),
            run=run,
            code=query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            field="",
            why="a drive while it is interlocked",
        )

    def check_resets(self) -> None:
        """Check that a reset clears the latch, that the state stream reports it, and that the rig plays again."""
        self._need()
        bench = self._bench
        state = bench.reset()
        expect(
            state.mode == rig_pb2.RIG_MODE_IDLE and not state.reason,
            f"a reset is answered with {rig_pb2.RigMode.Name(state.mode)} ({state.reason!r}) instead of an idle rig.",
        )
        latched = (rig_pb2.RIG_MODE_INTERLOCKED, "")

        def idle() -> bool:
            modes = bench.modes()
            after = len(modes) - modes[::-1].index(latched) if latched in modes else 0
            return (rig_pb2.RIG_MODE_IDLE, "") in modes[after:]

        bench.wait(idle)
        expect(idle(), "the state stream never said that it is idle after the reset.")
        bench.play(bench.new_run(), np.zeros((len(bench.description.drives), 10)))

    def clean_up(self) -> None:
        """Wait for the end of a playback that was not stopped, and clear the latch of this check."""
        if self._playing is not None:
            self._playing.join(PATIENCE_SECONDS + self._bench.seconds)
        if self._stopped and self._bench.state().reason == REASON:
            self._bench.reset()

    def _need(self) -> None:
        if not self._stopped:
            raise NotTriedError("no playback was stopped.")

    def _played_samples(self) -> int:
        items = self._bench.blocks_of(self._run)
        return int(items[-1].message.first_sample) + int(items[-1].message.drive.shape[1]) if items else 0

    def _wait_until_it_plays(self) -> float:
        """Wait until a part of the drive is played; return the time at which its begin was observed."""
        bench = self._bench
        # A gateway that waits for its controller cannot report the begin of the drive.
        begun = {(mode, self._run) for mode in (rig_pb2.RIG_MODE_PLAYING, rig_pb2.RIG_MODE_WAITING)}
        bench.wait(
            lambda: not begun.isdisjoint(bench.modes()) or self._played_samples() > 0 or self._outcome is not None
        )
        began = time.monotonic()
        if bench.description.publishes_after_run:
            # Without blocks, estimate the progress from the time: it plays in real time.
            bench.wait(lambda: self._outcome is not None, _STOP_AT * bench.seconds)
            return began
        bench.wait(lambda: self._played_samples() >= _STOP_AT * self._drive.shape[1] or self._outcome is not None)
        late = time.monotonic() - began
        expect(
            late < _WHOLE * bench.seconds,
            f"the signal blocks came {late:.1f} s after the drive of {bench.seconds:g} s began; publish them while it "
            "plays, or say publishes_after_run in the description.",
        )
        return began

    def _play(self) -> None:
        try:
            self._outcome = self._bench.play(self._run, self._drive, real_time=True)
        except FaultError as fault:
            self._outcome = fault
        except BusError:
            pass  # The check ended before the playback.
