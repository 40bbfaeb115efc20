"""A rig on the bus: turns the contract's queries into playbacks. One `RigServer` per rig."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from datetime import date
from typing import Final, NoReturn

import numpy as np
import structlog

from duralab_bus import Bus, Call, FaultError, Metrics, SpoolFullError, SpoolSpace
from duralab_gateway.channels import ChannelTable
from duralab_gateway.description import check_drive
from duralab_gateway.equipped_rig import EquippedRig
from duralab_gateway.interlock import LONGEST_NAME, LONGEST_REASON, Interlock
from duralab_gateway.motion import RigFaultError
from duralab_gateway.playback_session import PlaybackSession
from duralab_gateway.rig import KnowsItsFrf, PlaybackRig
from duralab_proto.arrays import from_array, from_record, to_array
from duralab_proto.channels import overdue_calibrations
from duralab_proto.keys import KeyNameError, check_run
from duralab_proto.v1 import query_pb2, rig_pb2

#: Label of a rig's metrics.
_RIG: Final = ("rig",)


class RigMetrics:
    """Metrics of a rig: whether it is latched or plays, its speed, and the number of its ended playbacks."""

    def __init__(self, metrics: Metrics, rig: str, state: Callable[[], rig_pb2.RigState]) -> None:
        self._rig = rig
        self._factor: dict[tuple[str, ...], float] = {}
        self._playbacks = metrics.count(
            "duralab_rig_playbacks_total", "Playbacks that ended, by rig and code", labels=("rig", "code")
        )
        self._seconds = metrics.count(
            "duralab_rig_played_seconds_total", "Length of the drives played to their end", labels=_RIG
        )
        readings: tuple[tuple[str, str, Callable[[rig_pb2.RigState], float]], ...] = (
            ("interlocked", "1 while the rig is latched", lambda now: now.mode == rig_pb2.RIG_MODE_INTERLOCKED),
            ("playing", "1 while a run moves the rig", lambda now: now.run != ""),
            ("run_fraction", "Share of the run that is played", lambda now: now.fraction),
        )
        for name, what, read in readings:
            metrics.follow(f"duralab_rig_{name}", what, lambda read=read: {(rig,): float(read(state()))}, labels=_RIG)
        metrics.follow(
            "duralab_rig_real_time_factor", "Seconds of drive a second, of the last playback", self._read, labels=_RIG
        )

    def played(self, result: rig_pb2.PlayResult, *, seconds: float) -> None:
        """Count a completed playback."""
        self._playbacks.add(self._rig, "OK")
        self._seconds.add(self._rig, amount=seconds)
        self._factor = {(self._rig,): result.real_time_factor}

    def broken_off(self, code: str) -> None:
        """Count an aborted playback, with the fault's code."""
        self._playbacks.add(self._rig, code)

    def _read(self) -> Mapping[tuple[str, ...], float]:
        return self._factor


#: Largest number of lines of one answer; each line of a 6 by 4 rig takes 384 bytes.
MOST_LINES = 200_000


def answer_frf(rig: object, description: rig_pb2.RigDescription, request: rig_pb2.RigFrfRequest) -> rig_pb2.RigFrf:
    """Return the FRF (frequencies, responses, drives) of a rig that knows it, at frequencies in Hz.

    Raises `FaultError` UNIMPLEMENTED if the rig does not know its FRF, INVALID_ARGUMENT if a frequency is outside 0 to
    half its sample rate, or the number of frequencies is not allowed.
    """
    name, rate = description.rig, description.sample_rate
    if not isinstance(rig, KnowsItsFrf):
        raise FaultError(
            query_pb2.FAULT_CODE_UNIMPLEMENTED,
            f"{name} does not know its FRF: it is not linear; identify it with the identifier.",
        )
    frequency = from_array(request.frequency, field="frequency", shape=(None,), dtype=np.float64)
    wrong = f"{name} knows its FRF at frequencies from 0 to {rate / 2.0:g} Hz, at most {MOST_LINES} at once"
    if not 1 <= len(frequency) <= MOST_LINES:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT, f"frequency has {len(frequency)} lines; {wrong}.", field="frequency"
        )
    beyond = ~((frequency >= 0.0) & (frequency <= rate / 2.0))
    if np.any(beyond):
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            f"frequency holds {frequency[beyond][0]:g} Hz; {wrong}.",
            field="frequency",
        )
    frf = rig.sampled_frf(frequency)
    return rig_pb2.RigFrf(
        rig=name, frequency=to_array(frequency), frf=to_array(frf), content_hash=description.content_hash
    )


#: Name in the contract of every process that serves rigs.
SERVICE: Final = "rig_sim"


class RigServer:
    """Server of one rig: description, play, stop, reset, state, FRF, its signal stream and its poses.

    The caller declares the rig live afterwards, and calls `close` before the bus closes.

    Parameters
    ----------
    bus : Bus
        Bus of the rig, under the name in its description.
    rig : PlaybackRig
        Rig to serve; a `StepwiseRig` for a `Rig`.
    spools : SpoolSpace
        Space for signal blocks until the recorder has stored them.
    spool_wait_seconds : float
        Time for which a simulation waits for room there, in s.
    real_time : bool
        Whether to play every drive in real time, regardless of its request.
    channels : ChannelTable
        Sensors and calculated channels that are added to the responses.

    Raises
    ------
    ConfigError
        If the table does not fit the rig, or a sensor in its description is not possible; one sentence.
    """

    def __init__(
        self,
        bus: Bus,
        rig: PlaybackRig,
        spools: SpoolSpace,
        *,
        spool_wait_seconds: float,
        real_time: bool = False,
        channels: ChannelTable = ChannelTable(),  # noqa: B008 - frozen
    ) -> None:
        self._rig = rig = EquippedRig(rig, channels)
        self._real_time = real_time
        self._description = rig.describe()
        self.name = self._description.rig
        self._log = structlog.get_logger(SERVICE).bind(rig=self.name)
        for sentence in overdue_calibrations(self._description.responses, today=date.today()):
            self._log.warning("calibration overdue", what=sentence)
        self._interlock = Interlock(self.name)
        self._metrics = RigMetrics(bus.metrics, self.name, self._interlock.state)
        self._publishing = threading.Lock()
        keys = bus.keys
        self._states = bus.publisher(keys.rig_state(self.name))
        self._session = PlaybackSession(
            bus,
            rig,
            self._description,
            self._interlock,
            latch=self._latch,
            report_state=self._publish_state,
            spools=spools,
            spool_wait_seconds=spool_wait_seconds,
        )
        bus.serve(keys.rig_description(self.name), rig_pb2.DescriptionRequest, lambda *_: self._description)
        bus.serve(keys.rig_frf(self.name), rig_pb2.RigFrfRequest, self._answer_frf)
        # Separate workers: several rigs play at the same time, a second play query receives the answer "busy", and a
        # stop is received while all other workers are in use.
        bus.serve(keys.rig_play(self.name), rig_pb2.PlayRequest, self._play, workers=2)
        bus.serve(keys.rig_stop(self.name), rig_pb2.StopRequest, self._on_stop, workers=4)
        bus.serve(keys.rig_reset(self.name), rig_pb2.ResetRequest, self._on_reset, workers=4)
        bus.serve(keys.rig_state(self.name), rig_pb2.StateRequest, lambda *_: self._interlock.state())

    def close(self) -> None:
        """End a present playback; nothing plays afterwards."""
        self._trip("the service ends")

    def _answer_frf(self, request: rig_pb2.RigFrfRequest, _call: Call) -> rig_pb2.RigFrf:
        return answer_frf(self._rig.knowing, self._description, request)

    def _play(self, request: rig_pb2.PlayRequest, call: Call) -> rig_pb2.PlayResult:
        try:
            run = check_run(request.run)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field="run") from error
        channels, sample_rate, drive = from_record(request.drive, field="drive")
        steps_in = self._rig.approach.ramp == 0.0
        check_drive(self._description, channels, sample_rate, drive, steps_in=steps_in)
        self._interlock.begin(run)
        try:
            self._publish_state()
            real_time = self._real_time or request.real_time
            result = self._session.play(request, drive, call, real_time=real_time)
            self._metrics.played(result, seconds=drive.shape[1] / sample_rate)
            return result
        except FaultError as fault:
            self._metrics.broken_off(fault.code_name)
            raise
        finally:
            self._interlock.end()
            self._publish_state()

    def stop(self, reason: str) -> None:
        """Latch, and ramp down a present playback; does not wait for it."""
        # The stop is published now, and the rest afterwards.
        self._latch(reason)
        self._log.warning("stopped", reason=self._interlock.state().reason)

    def _on_stop(self, request: rig_pb2.StopRequest, _call: Call) -> rig_pb2.RigState:
        self.stop(request.reason)
        # A run that continues to its end is named in the state.
        return self._interlock.state() if self._description.cannot_be_stopped else self._interlock.wait_for_rest()

    def _on_reset(self, request: rig_pb2.ResetRequest, _call: Call) -> rig_pb2.RigState:
        seen = self._interlock.trips
        _check_said(request)
        if request.command:
            # In any state of the rig: an old command must not clear a latch that is set later.
            try:
                self._interlock.claim(check_run(request.command))
            except KeyNameError as error:
                raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field="command") from error
        if self._interlock.state().mode == rig_pb2.RIG_MODE_INTERLOCKED:
            # Neither a latch of a rig that still ramps down nor a latch set meanwhile is cleared.
            self._interlock.wait_for_rest()
            self._make_ready(seen, request)
            self._publish_state()
            self._log.info("reset", who=request.name, reason=request.reason)
        return self._interlock.state()

    def _make_ready(self, seen: int, request: rig_pb2.ResetRequest) -> None:
        try:
            self._rig.reset()
        except RigFaultError as error:
            sentence = f"{self.name} cannot be reset: {error}"
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, sentence) from error
        try:
            self._interlock.reset(seen=seen, name=request.name, reason=request.reason)
        except FaultError:
            # The rig was stopped during its reset, and may have lost that stop.
            self._stop_rig(self._interlock.state().reason)
            raise

    def _latch(self, reason: str) -> None:
        self._trip(reason)
        self._publish_state()

    def _trip(self, reason: str) -> None:
        self._stop_rig(self._interlock.trip(reason))

    def _stop_rig(self, reason: str) -> None:
        if self._description.cannot_be_stopped:
            return
        try:
            self._rig.stop(reason)
        except Exception:  # noqa: BLE001 - a stop latches and comes to rest regardless of the controller
            self._log.exception("the rig could not be told to stop")

    def _publish_state(self) -> None:
        # Read and sent under one lock: otherwise a state could overtake a later one.
        with self._publishing:
            try:
                self._states.put(self._interlock.state())
            except SpoolFullError as error:
                # Queries still return the state; and no stop may fail because its state is not stored.
                self._log.warning("a state is not published", reason=str(error))


def _check_said(request: rig_pb2.ResetRequest) -> None:
    # Unlike a stop, which is carried out regardless of its reason, a reset may be refused.
    for field, longest in (("name", LONGEST_NAME), ("reason", LONGEST_REASON)):
        said = getattr(request, field)
        if len(said) > longest:
            sentence = f"{field} has {len(said)} characters; give at most {longest}."
        elif said and (not said.strip() or not said.isprintable()):
            sentence = f"{field} is {said[:80]!r}; give printable characters on one line, not only blanks."
        else:
            continue
        raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, sentence, field=field)


def serve_refusal(bus: Bus, rig: str, reason: str) -> None:
    """Answer every query of a rig with the fault FAILED_PRECONDITION.

    Parameters
    ----------
    bus : Bus
        Bus on which it would have been served.
    rig : str
        Name of the rig.
    reason : str
        Reason why it cannot be used, one sentence.

    Raises
    ------
    FaultError
        Raised to each client, from its query.
    """

    def refuse(_request: object, _call: Call) -> NoReturn:
        raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"{rig} cannot be used: {reason}")

    keys = bus.keys
    for key, request in (
        (keys.rig_description(rig), rig_pb2.DescriptionRequest),
        (keys.rig_frf(rig), rig_pb2.RigFrfRequest),
        (keys.rig_play(rig), rig_pb2.PlayRequest),
        (keys.rig_stop(rig), rig_pb2.StopRequest),
        (keys.rig_reset(rig), rig_pb2.ResetRequest),
        (keys.rig_state(rig), rig_pb2.StateRequest),
    ):
        bus.serve(key, request, refuse)
