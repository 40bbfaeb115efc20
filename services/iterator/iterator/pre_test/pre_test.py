"""One pre-test on the bus: announced, played once, judged, and kept as a recording."""

from __future__ import annotations

import threading
from datetime import date
from typing import Final

import numpy as np
import structlog
from numpy.typing import NDArray

from duralab_bus import Bus, Call, FaultError, RecordingLog, bring_to_rest, described_rig
from duralab_proto.arrays import ArrayError, from_record, to_array, to_record
from duralab_proto.channels import overdue_calibrations
from duralab_proto.v1 import array_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.campaign import (
    drive_limits,
    expect_free_id,
    static_response_of,
)
from iterator.pre_test.judging import Check, Drive, Finding, Judgement, ResponseChannel, judge
from iterator.pre_test.pulses import LARGEST_LEVEL, PulseTrain, pulse_train
from iterator.pre_test.stored import StoredExpectation, close_left, stored_expectation

# Road inputs have no effect on a wheel that does not roll.
_NOT_ALONE: Final = (array_pb2.CHANNEL_KIND_VELOCITY, array_pb2.CHANNEL_KIND_RATIO)
_SIGNS: Final = {array_pb2.POLARITY_POSITIVE: 1, array_pb2.POLARITY_NEGATIVE: -1}


def perform_pre_test(bus: Bus, request: iterator_pb2.PreTestRequest, call: Call) -> iterator_pb2.PreTest:
    """Perform the pre-test of a free rig.

    `bus`: Bus of rig and recorder. `request`: Request with checked id and rig. `call`: Receives the progress; a
    client that stopped waiting stops the rig.
    Returns: Result as stored in the closed recording.
    Raises `FaultError`: The request does not fit the rig, the rig does not play, or the recorder does not store.
    """
    level = _level(request.level)
    expect_free_id(bus, request.id)
    description = described_rig(bus, request.rig)
    _require_ranges(description)
    train = pulse_train(drive_limits(description), sample_rate=description.sample_rate, level=level)
    seconds = train.drive.shape[1] / description.sample_rate
    if seconds > description.longest_drive_seconds:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The pre-test takes {seconds:g} s, and {request.rig} plays {description.longest_drive_seconds:g} s at "
            "most; raise longest_drive_seconds of the rig.",
            field="rig",
        )
    overdue = overdue_calibrations(description.responses, today=date.today())
    # The first progress: the bus omits later ones that follow soon.
    call.progress("checking", 0.0, detail=" ".join(overdue) or f"pre-test of {request.rig}")
    for sentence in overdue:
        structlog.get_logger("iterator").warning("calibration overdue", rig=request.rig, what=sentence)
    close_left(bus, request.rig)
    stored = stored_expectation(bus, description, train)
    recording = _Recording(bus, request, description)
    try:
        played = recording.play(train, call)
        result = _result(request, description, train, played, stored=stored, overdue=overdue)
        recording.log.commit(result)
        recording.log.commit(
            recorder_pb2.RunPlayed(run=played.run, rig=request.rig, epoch=played.epoch, blocks=played.blocks)
        )
    except BaseException as error:
        recording.broken_off(error)
        raise
    verdict = iterator_pb2.PreTestVerdict.Name(result.verdict).removeprefix("PRE_TEST_VERDICT_").lower()
    recording.log.commit(recorder_pb2.RecordingClosed(reason=f"the pre-test {verdict}"))
    structlog.get_logger("iterator").info("pre-test", rig=request.rig, recording=request.id, verdict=verdict)
    return result


def _level(asked: float) -> float:
    if asked == 0.0:
        return LARGEST_LEVEL
    if not 0.0 < asked <= LARGEST_LEVEL:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            f"level is {asked:g}; a pre-test uses above 0 to {LARGEST_LEVEL:g} of the limits.",
            field="level",
        )
    return asked


def _require_ranges(description: rig_pb2.RigDescription) -> None:
    """Refuse a rig without finite limits and ranges: the level is a share of them."""
    for channel in (*description.drives, *description.responses):
        if not (np.isfinite([channel.minimum, channel.maximum]).all() and channel.minimum < channel.maximum):
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"{channel.name} of {description.rig} goes from {channel.minimum:g} to {channel.maximum:g}; a pre-test "
                "needs a finite range of each channel: correct the description of the rig.",
                field="rig",
            )


class _Recording:
    """Recording of a pre-test, begun before any motion, and its single run."""

    def __init__(self, bus: Bus, request: iterator_pb2.PreTestRequest, description: rig_pb2.RigDescription) -> None:
        self._bus, self._request, self._description = bus, request, description
        self._run = f"{request.id}.pulses"
        self._moving = False
        self.log = RecordingLog(bus, request.id)
        for step in (request, description, recorder_pb2.RunPlanned(run=self._run, rig=request.rig, purpose="pre-test")):
            self.log.commit(step)

    def play(self, train: PulseTrain, call: Call) -> rig_pb2.PlayResult:
        """Play the pulses once; a client that stopped waiting stops them."""
        request, description = self._request, self._description
        given_up = threading.Event()

        def follow(progress: query_pb2.Progress) -> None:
            # The rig sends progress continuously, so a client that stopped waiting is noticed within a second.
            if call.cancelled:
                given_up.set()
            call.progress(
                progress.phase, progress.fraction, remaining_seconds=progress.remaining_seconds, detail=progress.detail
            )

        if call.cancelled:
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "The pre-test was cancelled before anything moved.")
        self._moving = True
        played = self._bus.query(
            self._bus.keys.rig_play(request.rig),
            rig_pb2.PlayRequest(
                run=self._run,
                drive=to_record(description.drives, description.sample_rate, train.drive),
                seed=request.seed,
                real_time=request.real_time,
            ),
            rig_pb2.PlayResult,
            on_progress=follow,
            cancel=given_up,
        )
        self._moving = False
        if played.run != self._run:
            raise _damaged(f"The rig answered run {played.run!r}; asked was {self._run!r}.")
        return played

    def broken_off(self, error: BaseException) -> None:
        """Bring the rig to rest, and close the recording if possible."""
        reason = f"the pre-test was broken off: {error}"
        if self._moving:
            bring_to_rest(self._bus, self._request.rig, run=self._run, reason=reason)
        try:
            self.log.commit(recorder_pb2.RecordingClosed(reason=reason))
        except FaultError as fault:
            structlog.get_logger("iterator").warning("The recording stays open.", why=fault.message)


def _result(
    request: iterator_pb2.PreTestRequest,
    description: rig_pb2.RigDescription,
    train: PulseTrain,
    played: rig_pb2.PlayResult,
    *,
    stored: StoredExpectation | None,
    overdue: list[str],
) -> iterator_pb2.PreTest:
    response = _checked(played, description, samples=train.drive.shape[1])
    static = static_response_of(description)
    saturated = {use.drive: use.saturated_share for use in played.actuators}
    judgement = judge(
        train,
        response,
        drives=[
            Drive(channel.name, channel.kind not in _NOT_ALONE, saturated.get(channel.name, 0.0))
            for channel in description.drives
        ],
        responses=[
            ResponseChannel(
                channel.name,
                channel.unit,
                channel.minimum,
                channel.maximum,
                float(static[row]),
                _SIGNS.get(channel.sensor.polarity, 0),
                channel.sensor.drive,
            )
            for row, channel in enumerate(description.responses)
        ],
        sample_rate=description.sample_rate,
        expected=None if stored is None else stored.expectation,
    )
    calibrations = [Finding(Check.CALIBRATION, (), sentence, failed=False) for sentence in overdue]
    warnings = [Finding(Check.SATURATION, (), sentence, failed=False) for sentence in played.warnings]
    rest = response[:, : train.rest].mean(axis=1)
    return iterator_pb2.PreTest(
        id=request.id,
        rig=request.rig,
        rig_content_hash=description.content_hash,
        verdict=iterator_pb2.PRE_TEST_VERDICT_PASSED if judgement.passed else iterator_pb2.PRE_TEST_VERDICT_FAILED,
        findings=[_finding(finding) for finding in (*calibrations, *judgement.findings, *warnings)],
        expectations=_expectations(description, stored),
        drives=description.drives,
        responses=description.responses,
        sample_rate=description.sample_rate,
        amplitude=to_array(train.amplitude),
        response=to_array((response - rest[:, None]).astype(np.float32)),
        run=played.run,
        signal_epoch=played.epoch,
        signal_blocks=played.blocks,
        **_figures(judgement),
    )


def _figures(judgement: Judgement) -> dict[str, array_pb2.Array]:
    names = ("offset", "noise", "peak", "lag", "gain")
    return {name: to_array(np.ascontiguousarray(getattr(judgement, name))) for name in names}


def _finding(finding: Finding) -> iterator_pb2.PreTestFinding:
    return iterator_pb2.PreTestFinding(
        check=getattr(iterator_pb2, finding.check.value),
        channels=finding.channels,
        failed=finding.failed,
        sentence=finding.sentence,
    )


def _expectations(description: rig_pb2.RigDescription, stored: StoredExpectation | None) -> list[str]:
    """Return sentences on the references of polarity and order, and on the missing checks."""
    stated = [one.name for one in description.responses if one.sensor.polarity]
    silent = [one.name for one in description.responses if not one.sensor.polarity]
    said = [f"The polarity of {', '.join(stated)} is compared with the sensor table."] if stated else []
    if stored is not None:
        return [stored.sentence, *said]
    if silent:
        said.append(
            f"The polarity of {', '.join(silent)} is not checked: the sensor table does not state it, and no "
            "identification and no passed pre-test of this rig is stored."
        )
    named = [one.name for one in description.responses if one.sensor.drive]
    if len(named) < len(description.responses):
        others = [one.name for one in description.responses if not one.sensor.drive]
        said.append(f"Whether {', '.join(others)} are swapped with others is not checked, for the same reason.")
    return said


def _checked(played: rig_pb2.PlayResult, description: rig_pb2.RigDescription, *, samples: int) -> NDArray[np.float64]:
    try:
        channels, sample_rate, response = from_record(played.response, field="response")
    except ArrayError as error:
        raise _damaged(f"The rig answered a damaged response: {error}") from error
    names = [channel.name for channel in description.responses]
    if [channel.name for channel in channels] != names or (sample_rate, response.shape[1]) != (
        description.sample_rate,
        samples,
    ):
        raise _damaged(
            f"The rig answered {response.shape[1]} samples of {len(channels)} channels at {sample_rate:g} Hz; "
            f"{samples} of {len(names)} at {description.sample_rate:g} Hz were asked for."
        )
    return response


def _damaged(sentence: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_DATA_LOSS, sentence, field="response")
