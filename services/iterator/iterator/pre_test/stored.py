"""Recordings of a rig for its pre-test: an identification, earlier pre-tests, an interrupted one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from duralab_bus import Bus, FaultError, RecordingLog, recorded_steps
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.pre_test.expectation import Expectation, KnownFrf, expected_of_model, in_windows, within
from iterator.pre_test.pulses import PulseTrain

# Recordings are searched from the newest; older ones than these are outdated.
_MOST_SEARCHED: Final = 20
# The model of a campaign and the result of a pre-test are among these.
_FIRST_STEPS: Final = 8
_HOUR_NANOSECONDS: Final = 3600e9

_JUDGED: Final = (iterator_pb2.PRE_TEST_VERDICT_PASSED, iterator_pb2.PRE_TEST_VERDICT_FAILED)

MessageT = TypeVar("MessageT", bound=Message)


@dataclass(frozen=True)
class StoredExpectation:
    """An expectation and the sentence that describes its source."""

    expectation: Expectation
    sentence: str


def stored_expectation(bus: Bus, description: rig_pb2.RigDescription, train: PulseTrain) -> StoredExpectation | None:
    """Return the expectation from the newest identification of the rig, or from its newest passed pre-test."""
    newest = list(_newest_first(bus, description.rig))
    campaigns = [one for one in newest if one.pre_test == iterator_pb2.PRE_TEST_VERDICT_UNSPECIFIED]
    for information in campaigns[:_MOST_SEARCHED]:
        model = _step_of(bus, information, identifier_pb2.Model)
        if model is not None and _same_channels(model, description):
            found = _of_model(model, train)
            if found is not None:
                what = f"the identification in recording {information.recording!r}"
                return _with_sentence(found, what, changed=model.rig_content_hash != description.content_hash)
    passed = [one for one in newest if one.pre_test == iterator_pb2.PRE_TEST_VERDICT_PASSED]
    for information in passed[:_MOST_SEARCHED]:
        earlier = _step_of(bus, information, iterator_pb2.PreTest)
        if earlier is not None and _same_channels(earlier, description):
            found = _of_pre_test(earlier, train)
            if found is not None:
                what = f"the pre-test {information.recording!r}"
                return _with_sentence(found, what, changed=earlier.rig_content_hash != description.content_hash)
    return None


def _with_sentence(expectation: Expectation, what: str, *, changed: bool) -> StoredExpectation:
    since = ", of the rig before it was changed" if changed else ""
    return StoredExpectation(expectation, f"Polarity, order, lag and gain are compared with {what}{since}.")


def _of_model(model: identifier_pb2.Model, train: PulseTrain) -> Expectation | None:
    try:
        frequency = from_array(model.frequency, field="frequency", shape=(None,), dtype=np.float64)
        shape = (frequency.size, len(model.responses), len(model.drives))
        frf = from_array(model.frf, field="frf", shape=shape, dtype=np.complex128, finite=False)
    except ArrayError:
        return None
    known = KnownFrf(frequency, frf, (model.lowest_frequency, model.highest_frequency))
    return expected_of_model(known, train, model.sample_rate)


def _of_pre_test(earlier: iterator_pb2.PreTest, train: PulseTrain) -> Expectation | None:
    """Return the responses of an earlier pre-test; None if its pulses had other relative sizes."""
    try:
        amplitude = from_array(earlier.amplitude, field="amplitude", shape=train.amplitude.shape, dtype=np.float64)
        shape = (len(earlier.responses), train.drive.shape[1])
        response = from_array(earlier.response, field="response", shape=shape, dtype=np.float32)
    except ArrayError:
        return None
    ratio = train.amplitude / amplitude
    if not np.allclose(ratio, ratio[0], rtol=1e-6):
        return None
    parts = in_windows(ratio[0] * response.astype(np.float64), train)
    return Expectation(within(None, parts, earlier.sample_rate))


def _same_channels(stored: identifier_pb2.Model | iterator_pb2.PreTest, description: rig_pb2.RigDescription) -> bool:
    return stored.sample_rate == description.sample_rate and all(
        [(channel.name, channel.unit) for channel in there] == [(channel.name, channel.unit) for channel in here]
        for there, here in ((stored.drives, description.drives), (stored.responses, description.responses))
    )


def _newest_first(bus: Bus, rig: str) -> Iterator[recorder_pb2.RecordingInfo]:
    request = recorder_pb2.ListRecordingsRequest(rig=rig)
    found = bus.query(bus.keys.recordings(), request, recorder_pb2.RecordingList).recordings
    return iter(sorted(found, key=lambda information: information.begun, reverse=True))


def _step_of(bus: Bus, information: recorder_pb2.RecordingInfo, kind: type[MessageT]) -> MessageT | None:
    """Return the first step of a kind among the first steps of a recording; None if there is none or it is damaged."""
    try:
        for step in islice(recorded_steps(bus, information.recording), _FIRST_STEPS):
            if step.message_type == kind.DESCRIPTOR.full_name:
                return kind.FromString(step.payload)
    except FaultError as fault:
        if fault.code not in (query_pb2.FAULT_CODE_DATA_LOSS, query_pb2.FAULT_CODE_NOT_FOUND):
            raise
    except DecodeError:
        pass
    return None


def close_left(bus: Bus, rig: str) -> None:
    """Close the recordings of pre-tests that a crash of the iterator interrupted; they are not continued."""
    for information in _newest_first(bus, rig):
        if information.pre_test == iterator_pb2.PRE_TEST_VERDICT_UNFINISHED and not information.ended:
            log = RecordingLog(bus, information.recording, next_step=information.steps)
            log.commit(recorder_pb2.RecordingClosed(reason="the iterator ended before the pre-test did"))


def require_pre_test(bus: Bus, spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription) -> str:
    """Refuse a campaign that demands a pre-test, unless one of this rig passed and is new enough.

    `bus`: Bus of the recorder. `spec`: Specification of the campaign. `description`: Present description of the rig.
    Returns: A sentence that names the pre-test; empty if none is demanded.
    Raises `FaultError`: FAILED_PRECONDITION with the field `pre_test`.
    """
    hours = spec.pre_test
    if hours == 0.0:
        return ""
    demand = f"The campaign demands a pre-test of {spec.rig} that passed within the last {hours:g} hours"
    remedy = f"run `duralab pre-test {spec.rig}`"
    newest = next((one for one in _newest_first(bus, spec.rig) if one.ended and one.pre_test in _JUDGED), None)
    if newest is None:
        raise _refused(f"{demand}, and there is none; {remedy}.")
    age = (time.time_ns() - newest.begun) / _HOUR_NANOSECONDS
    if newest.pre_test != iterator_pb2.PRE_TEST_VERDICT_PASSED:
        raise _refused(
            f"{demand}, and the newest, {newest.recording!r}, did not pass; see to its findings and {remedy}."
        )
    if age > hours:
        raise _refused(f"{demand}, and the newest, {newest.recording!r}, is {age:.1f} hours old; {remedy}.")
    found = _step_of(bus, newest, iterator_pb2.PreTest)
    if found is None or found.rig_content_hash != description.content_hash:
        raise _refused(f"{demand}, and the rig was changed since the newest, {newest.recording!r}; {remedy}.")
    return f"The pre-test {newest.recording!r} of {spec.rig} passed {age:.1f} hours before the campaign."


def _refused(sentence: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, sentence, field="pre_test")
