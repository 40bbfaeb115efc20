"""Checks of stop, latch and reset: a gentle playback in real time that is stopped half-way."""

from __future__ import annotations

import threading

import numpy as np

from duralab.conformance.bench import PATIENCE_SECONDS, REPAIR_SECONDS, Bench
from duralab.conformance.drives import gentle_drive
from duralab.conformance.finding import NotTriedError, expect
from duralab.conformance.play_checks import check_signal
from duralab.conformance.refusal_checks import check_refused
from duralab_proto.arrays import from_array
from duralab_proto.v1 import query_pb2, rig_pb2
from labbus import FaultError

REASON = "conformance check"
#: At the end of a ramp down, shares of a drive's limits.
_AT_ZERO = 1.0e-3
_STOP_AT = 0.4


class StopChecks:
    """One playback that is stopped."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._run = bench.new_run()
        self._outcome: FaultError | rig_pb2.PlayResult | None = None
        self._stopped = False

    def check_busy_and_stops(self) -> None:
        """Check that while it plays it refuses another drive; a stop latches it with the reason."""
        bench = self._bench
        drive = gentle_drive(bench.description, bench.seconds)
        thread = threading.Thread(target=self._play, args=(drive,), daemon=True)
        thread.start()
        bench.wait(lambda: self._played_samples() >= _STOP_AT * drive.shape[1] or self._outcome is not None)
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
        except Exception as error:  # noqa: BLE001 - the rig is stopped first, whatever it was
            busy = error
        state = bench.stop(REASON)
        self._stopped = True
        thread.join(PATIENCE_SECONDS)
        if busy is not None:
            raise busy
        expect(
            state.mode == rig_pb2.RIG_MODE_INTERLOCKED,
            f"a stop is answered with {rig_pb2.RigMode.Name(state.mode)} instead of RIG_MODE_INTERLOCKED.",
        )
        expect(state.reason == REASON, f"the latch has the reason {state.reason!r}; the stop said {REASON!r}.")
        expect(not state.run, f"a stop was answered while run {state.run!r} still plays; answer when it rests.")

    def check_ends_cancelled(self) -> None:
        """Check that the playback ends with CANCELLED."""
        self._need()
        expect(self._outcome is not None, "the stopped playback was never answered.")
        ended = self._outcome.code_name if isinstance(self._outcome, FaultError) else "a result"
        expect(ended == "CANCELLED", f"the stopped playback was answered with {ended} instead of CANCELLED.")

    def check_ramps_down(self) -> None:
        """Check that the blocks are whole, and bring all drives to zero without a jump."""
        self._need()
        bench, told = self._bench, self._bench.description
        bench.wait(lambda: any(item.message.last for item in bench.blocks_of(self._run)), REPAIR_SECONDS)
        check_signal(bench, self._run, epoch=None)
        drive = np.hstack([from_array(item.message.drive) for item in bench.blocks_of(self._run)])
        for channel, row in zip(told.drives, drive, strict=True):
            size = max(channel.maximum, -channel.minimum)
            expect(
                abs(row[-1]) <= _AT_ZERO * size,
                f"after the stop drive {channel.name!r} is left at {row[-1]:.4g} {channel.unit}; it must ramp to 0.",
            )
            fastest = float(np.max(np.abs(np.diff(row, prepend=0.0)))) * told.sample_rate
            expect(
                channel.slew_limit == 0.0 or fastest <= channel.slew_limit,
                f"after the stop drive {channel.name!r} moves at {fastest:.4g} {channel.unit}/s; "
                f"{channel.slew_limit:g} is its limit.",
            )

    def check_state(self) -> None:
        """Check that the state stream said so, with the reason."""
        self._need()
        bench = self._bench

        def told() -> bool:
            return any(
                item.message.mode == rig_pb2.RIG_MODE_INTERLOCKED and item.message.reason == REASON
                for item in list(bench.states)
            )

        bench.wait(told)
        expect(told(), "the state stream never said that it is interlocked, with the reason.")
        state = bench.state()
        expect(
            state.mode == rig_pb2.RIG_MODE_INTERLOCKED,
            f"after the stop the rig is {rig_pb2.RigMode.Name(state.mode)}; the latch must stay until a reset.",
        )

    def check_refuses(self) -> None:
        """Check that while latched, it refuses to play."""
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
        """Check that a reset clears the latch, the state stream says so, and it plays again."""
        self._need()
        bench = self._bench
        state = bench.reset()
        expect(
            state.mode == rig_pb2.RIG_MODE_IDLE and not state.reason,
            f"a reset is answered with {rig_pb2.RigMode.Name(state.mode)} ({state.reason!r}) instead of an idle rig.",
        )
        latched = (rig_pb2.RIG_MODE_INTERLOCKED, "")

        def told() -> bool:
            modes = bench.modes()
            after = len(modes) - modes[::-1].index(latched) if latched in modes else 0
            return (rig_pb2.RIG_MODE_IDLE, "") in modes[after:]

        bench.wait(told)
        expect(told(), "the state stream never said that it is idle after the reset.")
        bench.play(bench.new_run(), np.zeros((len(bench.description.drives), 10)))

    def clean_up(self) -> None:
        """Clear the latch of this check, whatever was found."""
        if self._stopped and self._bench.state().reason == REASON:
            self._bench.reset()

    def _need(self) -> None:
        if not self._stopped:
            raise NotTriedError("no playback was stopped.")

    def _played_samples(self) -> int:
        items = self._bench.blocks_of(self._run)
        return int(items[-1].message.first_sample) + int(items[-1].message.drive.shape[1]) if items else 0

    def _play(self, drive: np.ndarray) -> None:
        try:
            self._outcome = self._bench.play(self._run, drive, real_time=True)
        except FaultError as fault:
            self._outcome = fault
