"""A small rig gateway that keeps the contract, or breaks it in one way: the counterpart of the conformance check."""

from __future__ import annotations

import threading
import time
from enum import StrEnum

import numpy as np
import synthetic_campaign

from duralab_bus import Bus, FaultError, encoding_of
from duralab_proto.arrays import ArrayError, from_record, to_array, to_record
from duralab_proto.keys import check_run
from duralab_proto.v1 import query_pb2, rig_pb2

BLOCK = 20
RATE = 200.0
#: Delay after the run of a gateway that publishes late, in seconds.
LATE_SECONDS = 3.0


class Defect(StrEnum):
    """In which way it breaks the contract."""

    NONE = "none"
    OTHER_NAME = "other_name"
    HASH = "hash"
    UNIT_OF_KIND = "unit_of_kind"
    LIMITS = "limits"
    STATIC = "static"
    CHANGING = "changing"
    LATCHED = "latched"
    TAKES_RATE = "takes_rate"
    TAKES_COUNT = "takes_count"
    TAKES_ORDER = "takes_order"
    TAKES_UNIT = "takes_unit"
    TAKES_NAN = "takes_nan"
    TAKES_EMPTY = "takes_empty"
    TAKES_NAME = "takes_name"
    TAKES_JUMP = "takes_jump"
    TAKES_LIMIT = "takes_limit"
    TAKES_TWICE = "takes_twice"
    TAKES_WHILE_BUSY = "takes_while_busy"
    TAKES_WHILE_LATCHED = "takes_while_latched"
    NO_FIELD = "no_field"
    WRONG_CODE = "wrong_code"
    SHORT_RESPONSE = "short_response"
    NAN_RESPONSE = "nan_response"
    HURRIES = "hurries"
    LOSES_BLOCK = "loses_block"
    FORGETS_BLOCK = "forgets_block"
    NUMBERS_BLOCKS = "numbers_blocks"
    GAP_IN_SAMPLES = "gap_in_samples"
    NO_LAST = "no_last"
    OTHER_STREAM = "other_stream"
    LARGE_BLOCKS = "large_blocks"
    NEVER_PLAYING = "never_playing"
    NO_STATES = "no_states"
    NO_POSES = "no_poses"
    BAD_QUATERNION = "bad_quaternion"
    STOP_DOES_NOT_LATCH = "stop_does_not_latch"
    STOP_WITHOUT_REASON = "stop_without_reason"
    STOP_GIVES_RESULT = "stop_gives_result"
    DROPS_DEAD = "drops_dead"
    RESET_DOES_NOTHING = "reset_does_nothing"
    PUBLISHES_LATE = "publishes_late"
    STOP_DOES_NOT_WAIT = "stop_does_not_wait"
    STOP_CLAIMS_REST = "stop_claims_rest"
    STOP_IS_FORGOTTEN = "stop_is_forgotten"
    UNSTOPPABLE_STOPS = "unstoppable_stops"


#: Defects that only a rig can have that cannot be stopped.
GOES_ON = (Defect.STOP_CLAIMS_REST, Defect.STOP_IS_FORGOTTEN, Defect.UNSTOPPABLE_STOPS)


class Gateway:
    """One rig, with one defect; it may publish its blocks after the run, and its runs may go on to their end."""

    def __init__(
        self, bus: Bus, name: str, defect: Defect, *, publishes_after_run: bool = False, cannot_be_stopped: bool = False
    ) -> None:
        self.bus, self.name, self.defect = bus, name, defect
        self.publishes_after_run = publishes_after_run
        self.cannot_be_stopped = cannot_be_stopped or defect in GOES_ON
        self.lock = threading.Lock()
        self.latched = defect is Defect.LATCHED
        self.reason = "somebody was here" if self.latched else ""
        self.playing, self.runs, self.asked = "", set(), 0
        self.stopping, self.resting, self.never = threading.Event(), threading.Event(), threading.Event()
        self.resting.set()
        #: Cleared by a test that needs the run to be under way for as long as it looks.
        self.may_end = threading.Event()
        self.may_end.set()
        keys = bus.keys
        self.states, self.poses = bus.publisher(keys.rig_state(name)), bus.publisher(keys.rig_pose(name))
        bus.serve(keys.rig_description(name), rig_pb2.DescriptionRequest, lambda _r, _c: self.describe())
        bus.serve(keys.rig_play(name), rig_pb2.PlayRequest, self.play, workers=2)
        bus.serve(keys.rig_stop(name), rig_pb2.StopRequest, self.stop, workers=1)
        bus.serve(keys.rig_reset(name), rig_pb2.ResetRequest, self.reset, workers=1)
        bus.serve(keys.rig_state(name), rig_pb2.StateRequest, lambda _r, _c: self.state())
        bus.declare_live("rig_sim", name)

    def has(self, defect: Defect) -> bool:
        return self.defect is defect

    def describe(self) -> rig_pb2.RigDescription:
        told = synthetic_campaign.description(self.name)
        told.sample_rate, told.block_samples, told.engine = RATE, BLOCK, "fake"
        told.bodies.extend(["left_wheel", "right_wheel"])
        told.publishes_after_run, told.cannot_be_stopped = self.publishes_after_run, self.cannot_be_stopped
        self.asked += 1
        match self.defect:
            case Defect.OTHER_NAME:
                told.rig = "another"
            case Defect.HASH:
                told.content_hash = "42"
            case Defect.UNIT_OF_KIND:
                told.responses[1].unit = "kN"
            case Defect.LIMITS:
                told.drives[2].minimum = told.drives[2].maximum
            case Defect.STATIC:
                told.static_response.CopyFrom(to_array(np.zeros(5)))
            case Defect.CHANGING:
                told.version = str(self.asked)
        return told

    def state(self) -> rig_pb2.RigState:
        mode = rig_pb2.RIG_MODE_PLAYING if self.playing else rig_pb2.RIG_MODE_IDLE
        return rig_pb2.RigState(
            rig=self.name,
            mode=rig_pb2.RIG_MODE_INTERLOCKED if self.latched else mode,
            reason=self.reason,
            run=self.playing,
        )

    def publish_state(self) -> None:
        if self.has(Defect.NO_STATES) or (self.has(Defect.NEVER_PLAYING) and self.playing and not self.latched):
            return
        self.states.put(self.state())

    def refuse(self, defect: Defect, wrong: bool, field: str, code=query_pb2.FAULT_CODE_INVALID_ARGUMENT) -> None:
        if wrong and not self.has(defect):
            if self.has(Defect.WRONG_CODE):
                code = query_pb2.FAULT_CODE_INTERNAL
            raise FaultError(code, f"This is not allowed: {defect}.", field="" if self.has(Defect.NO_FIELD) else field)

    def check(self, request: rig_pb2.PlayRequest) -> np.ndarray:
        try:
            check_run(request.run)
        except ValueError:
            self.refuse(Defect.TAKES_NAME, True, "run")
        told = self.describe()
        try:
            channels, rate, drive = from_record(request.drive, field="drive")
        except ArrayError:
            self.refuse(Defect.TAKES_NAN, True, "drive.samples")
            return np.zeros((6, BLOCK))
        names, units = [c.name for c in channels], [c.unit for c in channels]
        self.refuse(Defect.TAKES_RATE, rate != RATE, "drive.sample_rate")
        self.refuse(Defect.TAKES_COUNT, len(names) != 6, "drive.channels")
        self.refuse(Defect.TAKES_ORDER, len(names) == 6 and names != [c.name for c in told.drives], "drive.channels")
        self.refuse(Defect.TAKES_UNIT, set(units) != {"m"}, "drive.channels")
        self.refuse(Defect.TAKES_EMPTY, drive.shape[1] == 0, "drive.samples")
        if drive.shape[1] and len(drive) == 6:
            peaks, limits = np.abs(drive).max(axis=1), np.array([c.maximum for c in told.drives])
            self.refuse(Defect.TAKES_LIMIT, bool((peaks > limits).any()), "drive.samples")
            steps = np.abs(np.diff(drive, prepend=0.0)).max() * RATE
            self.refuse(Defect.TAKES_JUMP, bool(steps > 2.0), "drive.samples")
        return drive if drive.shape[1] and len(drive) == 6 else np.zeros((6, BLOCK))

    def play(self, request: rig_pb2.PlayRequest, call) -> rig_pb2.PlayResult:
        drive = self.check(request)
        with self.lock:
            precondition = query_pb2.FAULT_CODE_FAILED_PRECONDITION
            self.refuse(Defect.TAKES_WHILE_LATCHED, self.latched, "", precondition)
            self.refuse(Defect.TAKES_WHILE_BUSY, bool(self.playing), "", query_pb2.FAULT_CODE_BUSY)
            twice = request.run in self.runs
            self.refuse(Defect.TAKES_TWICE, twice, "run", query_pb2.FAULT_CODE_ALREADY_EXISTS)
            self.runs.add(request.run)
            if self.playing or self.latched:
                return rig_pb2.PlayResult(run=request.run)
            self.playing = request.run
            self.resting.clear()
        self.publish_state()
        try:
            return self.perform(request, drive, call)
        finally:
            self.playing = ""
            if self.has(Defect.STOP_IS_FORGOTTEN):
                self.latched = False
            self.publish_state()
            self.resting.set()

    def perform(self, request, drive, call) -> rig_pb2.PlayResult:
        name = "other" if " " in request.run else request.run
        stream = self.bus.publisher(self.bus.keys.rig_signal(self.name, name))
        began, samples, sent, shown = time.monotonic(), drive.shape[1], 0, 0
        response = synthetic_campaign_response(drive)
        size = 2 * BLOCK if self.has(Defect.LARGE_BLOCKS) else BLOCK
        goes_on = self.cannot_be_stopped and not self.has(Defect.UNSTOPPABLE_STOPS)
        held: list[rig_pb2.SignalBlock] = []

        def put(first: int, piece: np.ndarray, answer: np.ndarray, *, last: bool) -> None:
            nonlocal sent
            sent += 1
            if self.has(Defect.LOSES_BLOCK) and sent == 3:
                return
            block = rig_pb2.SignalBlock(
                run=request.run,
                first_sample=first + (first > 0 and self.has(Defect.GAP_IN_SAMPLES)),
                sample_rate=RATE,
                drive=to_array(np.ascontiguousarray(piece)),
                response=to_array(answer + (1.0 if self.has(Defect.OTHER_STREAM) else 0.0)),
                last=last and not self.has(Defect.NO_LAST),
            )
            if self.has(Defect.FORGETS_BLOCK) and sent == 3:
                # As one that is lost on the way while a recorder is given it and marks it.
                spool = stream._spool
                spool.mark(spool.append(block.SerializeToString(), encoding_of(block)) + 1)
                return
            if self.publishes_after_run or self.has(Defect.PUBLISHES_LATE):
                held.append(block)
                if not last:
                    return
                if request.real_time and self.has(Defect.PUBLISHES_LATE):
                    # Late enough even if a busy machine reports the begin late to the check.
                    self.never.wait(LATE_SECONDS)
            else:
                held[:] = [block]
            for ready in held:
                stream.put(ready)
                if self.has(Defect.NUMBERS_BLOCKS):
                    stream.put(ready)

        for first in range(0, samples, size):
            end = min(first + size, samples)
            if request.real_time and not self.has(Defect.HURRIES):
                pause = max(began + end / RATE - time.monotonic(), 0.0)
                (self.never if goes_on else self.stopping).wait(pause)
            if end == samples:
                self.may_end.wait(60.0)
            stopped = self.stopping.is_set() and end < samples and not goes_on
            put(first, drive[:, first:end], response[:, first:end], last=end == samples)
            if end / RATE - shown >= 0.1 and not self.has(Defect.NO_POSES):
                shown = end / RATE
                pose = [0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 1.0 if self.has(Defect.BAD_QUATERNION) else 0.0]
                times, poses = to_array(np.array([shown])), to_array(np.array([[pose, pose]]))
                self.poses.put(rig_pb2.PoseBlock(run=request.run, time=times, poses=poses))
            call.progress("playing", end / samples)
            if stopped:
                ramp = drive[:, end - 1 : end] * np.linspace(1.0, 0.0, BLOCK)
                if self.has(Defect.DROPS_DEAD):
                    ramp = drive[:, end - 1 : end] * np.ones(BLOCK)
                put(end, ramp, synthetic_campaign_response(ramp), last=True)
                if self.has(Defect.STOP_GIVES_RESULT):
                    break
                raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "It was stopped.")
        answer = response[:, :-1] if self.has(Defect.SHORT_RESPONSE) else response.copy()
        record = to_record(synthetic_campaign.response_channels(), RATE, np.ascontiguousarray(answer))
        if self.has(Defect.NAN_RESPONSE):
            answer[0, 0] = np.nan
            record.samples.CopyFrom(to_array(answer))
        return rig_pb2.PlayResult(
            run=request.run,
            response=record,
            actuators=[rig_pb2.ActuatorUse(drive=c.name) for c in synthetic_campaign.drive_channels()],
            epoch=stream.epoch,
            blocks=sent,
            real_time_factor=1.0,
        )

    def stop(self, request: rig_pb2.StopRequest, call) -> rig_pb2.RigState:
        if not self.has(Defect.STOP_DOES_NOT_LATCH):
            self.latched = True
            self.reason = "" if self.has(Defect.STOP_WITHOUT_REASON) else request.reason
        # Before it is told to stop: a busy machine would come to the answer after the rig has come to rest.
        moving = self.state()
        self.stopping.set()
        self.publish_state()
        if not self.cannot_be_stopped and not self.has(Defect.STOP_DOES_NOT_WAIT):
            self.resting.wait(60.0)
        state = moving if self.has(Defect.STOP_DOES_NOT_WAIT) else self.state()
        if self.has(Defect.STOP_CLAIMS_REST):
            state.run = ""
        return state

    def reset(self, request: rig_pb2.ResetRequest, call) -> rig_pb2.RigState:
        if not self.has(Defect.RESET_DOES_NOTHING):
            self.resting.wait(60.0)
            self.latched, self.reason = False, ""
            self.stopping.clear()
            self.publish_state()
        return self.state()


def synthetic_campaign_response(drive: np.ndarray) -> np.ndarray:
    """Answer at once: stiffness and some cross-coupling."""
    return 1.0e4 * (np.eye(6) + 0.1) @ drive
