from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_proto.arrays import to_array
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from recorder.format import decode_step
from recorder.format.steps import STEP_TYPES
from recorder.log import Placement
from recorder.log.recording import StepOrder
from recorder.refused import RefusedError


def status_step(step_of, number, activity="playing"):
    return step_of(number, iterator_pb2.CampaignStatus(id="demo", activity=activity))


def test_the_same_step_again_is_stored_once(step_of):
    order = StepOrder("demo")
    step = status_step(step_of, 0)
    assert order.place(step) is Placement.NEW
    order.store(step)
    assert order.place(step) is Placement.STORED
    assert order.count == 1


def test_another_content_of_a_stored_step_is_refused(step_of):
    order = StepOrder("demo")
    order.store(status_step(step_of, 0))
    with pytest.raises(RefusedError, match="another content") as caught:
        order.place(status_step(step_of, 0, activity="identifying"))
    assert caught.value.code == query_pb2.FAULT_CODE_ALREADY_EXISTS


def test_the_same_bytes_as_another_type_are_another_content(step_of):
    order = StepOrder("demo")
    order.store(step_of(0, iterator_pb2.CampaignStatus()))
    with pytest.raises(RefusedError, match="another content"):
        order.place(step_of(0, recorder_pb2.RecordingClosed()))


def test_a_gap_is_refused_with_the_next_number(step_of):
    order = StepOrder("demo")
    order.store(status_step(step_of, 0))
    with pytest.raises(RefusedError, match="the next step is 1") as caught:
        order.place(status_step(step_of, 2))
    assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION


def test_nothing_follows_the_last_step(step_of):
    order = StepOrder("demo")
    closing = step_of(0, recorder_pb2.RecordingClosed(reason="done"))
    order.store(closing)
    assert order.place(closing) is Placement.STORED
    with pytest.raises(RefusedError, match="closed with 1 steps"):
        order.place(status_step(step_of, 1))


def test_unknown_types_are_refused(request_of):
    request = request_of(0, recorder_pb2.CommitAck())
    with pytest.raises(RefusedError, match="is not a step; allowed are") as caught:
        decode_step(request)
    assert caught.value.field == "message_type"


def test_a_channel_too_many_is_refused(campaign, request_of):
    step = campaign.iteration(1, 0.5)
    step.response_in_band.CopyFrom(to_array(np.zeros((3, 200))))
    with pytest.raises(RefusedError, match="shape") as caught:
        decode_step(request_of(0, step))
    assert caught.value.field == "payload.response_in_band"


def test_a_proposal_and_a_decision_are_stored_where_they_are_whole(campaign, request_of):
    drive = campaign.iteration(1, 0.5).drive
    responses = [iterator_pb2.ProposedResponse(channel="a")]
    predicted = to_array(np.zeros((1, drive.samples.shape[1]), dtype=np.float32))
    proposal = iterator_pb2.Proposal(
        number=1, playback=1, drive=drive, responses=responses, predicted_response=predicted
    )
    decision = iterator_pb2.Decision(
        proposal=1, playback=1, kind=iterator_pb2.DECISION_KIND_PLAY, name="Ada", reason="x"
    )
    for whole in (proposal, decision, iterator_pb2.Proposal(number=2, playback=1, refusal="past a limit")):
        assert decode_step(request_of(0, whole)).message == whole
    broken = [
        (proposal, {"number": 0}, "payload.number"),
        (proposal, {"responses": []}, "payload.predicted_response"),
        *(
            (decision, {field: type(getattr(decision, field))()}, f"payload.{field}")
            for field in ("name", "reason", "proposal")
        ),
    ]
    for whole, lacks, field in broken:
        message = type(whole).FromString(whole.SerializeToString())
        for name in lacks:
            message.ClearField(name)
        with pytest.raises(RefusedError) as caught:
            decode_step(request_of(0, message))
        assert caught.value.field == field


def test_nan_in_a_drive_is_refused(campaign, request_of):
    step = campaign.iteration(1, 0.5)
    samples = np.zeros((2, 200))
    samples[1, 7] = np.nan
    step.drive.samples.CopyFrom(to_array(samples))
    with pytest.raises(RefusedError, match=r"nan at index \(1, 7\)"):
        decode_step(request_of(0, step))


@pytest.mark.parametrize("blocks", [0, 2**32 + 1, 2**40, 2**64 - 1])
def test_more_blocks_than_a_log_can_number_are_refused_before_anybody_waits_for_them(campaign, request_of, blocks):
    with pytest.raises(RefusedError, match=rf"blocks is {blocks}; ") as caught:
        decode_step(request_of(0, campaign.played("demo.i01", epoch=1, blocks=blocks)))
    assert caught.value.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT


@pytest.mark.parametrize("run", ["", "../up", "a/b", "a*", "A", "x" * 200])
def test_run_names_that_could_leave_their_place_are_refused(campaign, request_of, run):
    with pytest.raises(RefusedError) as caught:
        decode_step(request_of(0, campaign.planned(run)))
    assert caught.value.field == "payload.run"


@given(kind=st.sampled_from(sorted(STEP_TYPES)), payload=st.binary(max_size=200))
def test_no_bytes_are_taken_that_are_not_a_sound_message(kind, payload):
    request = recorder_pb2.CommitRequest(recording="demo", message_type=kind, payload=payload)
    code = query_pb2.FAULT_CODE_UNSPECIFIED
    try:
        assert decode_step(request).payload == payload
    except RefusedError as refusal:
        code = refusal.code
    assert code in (query_pb2.FAULT_CODE_UNSPECIFIED, query_pb2.FAULT_CODE_INVALID_ARGUMENT)
