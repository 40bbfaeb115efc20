"""What may be taken up again under a new name, and that a crash of what was taken up loses nothing of it."""

from __future__ import annotations

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.keys import check_run
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2
from iterator.campaign import lacks_copies, new_campaign, same_campaign
from iterator.campaign.recorded import RecordedCampaign
from iterator.campaign.resumption import run_name

from .linear_plants import noise_target
from .wide_rig import specification, wide_lab

ITERATIONS = 3
# Specification, rig, target; copies of a model and two playbacks; the third one planned, stored, played; status, end.
CHILD_STEPS = 3 + 3 + 3 + 2


def recorded(phase: iterator_pb2.CampaignPhase | None) -> RecordedCampaign:
    """A campaign of three playbacks, all made; its last status where it got to write one."""
    spec = iterator_pb2.CampaignSpec(id="first")
    spec.stop.iterations = 3
    return RecordedCampaign(
        spec=spec,
        model=identifier_pb2.Model(),
        iterations=[iterator_pb2.IterationStep() for _ in range(3)],
        final=None if phase is None else iterator_pb2.CampaignStatus(phase=phase),
    )


@pytest.mark.parametrize("phase", [None, iterator_pb2.CAMPAIGN_PHASE_FAULTED, iterator_pb2.CAMPAIGN_PHASE_STOPPED])
def test_what_broke_off_after_its_last_playback_is_concluded_without_another(phase):
    request = iterator_pb2.ResumeCampaignRequest(new_id="second")
    spec, resumption = new_campaign(recorded(phase), request)
    assert (spec.id, spec.parent, spec.parent_iteration) == ("second", "first", 3)
    assert len(resumption.iterations) == spec.stop.iterations == 3


def test_what_is_finished_needs_more_playbacks_to_be_taken_up():
    request = iterator_pb2.ResumeCampaignRequest(new_id="second")
    with pytest.raises(FaultError, match="counts the 3 playbacks"):
        new_campaign(recorded(iterator_pb2.CAMPAIGN_PHASE_FINISHED), request)


@pytest.fixture(scope="module")
def lab():
    """A lab with a campaign, and another one that took it up after its second playback."""
    with wide_lab("iterator_taking_up") as lab:
        lab.start(specification("parent", iterations=ITERATIONS))
        assert lab.end_of("parent").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
        lab.resume("parent", new_id="child", from_iteration=2)
        assert lab.end_of("child").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
        yield lab


# After the specification, before the copies, after each of them, and after the result of its own playback.
@pytest.mark.parametrize("stored", [1, 3, 4, 5, 6, 8])
def test_a_campaign_that_was_taken_up_and_broke_off_takes_over_the_rest_and_goes_on(lab, stored):
    whole = lab.recorder.steps["child"]
    assert len(whole) == CHILD_STEPS
    # What the recorder holds when a crash comes after so many steps.
    lab.recorder.steps["child"] = whole[:stored]
    try:
        lab.resume("child")
        final = lab.end_of("child")
        assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED, final.fault.message
        assert [run.run for run in lab.recorder.read("child", recorder_pb2.RunPlanned)] == ["child.i03"]
        assert lab.recorder.kinds("child") == [kind for kind, _ in whole]
        results = [step.drive.samples.data for step in lab.recorder.read("child", iterator_pb2.IterationStep)]
        assert results == [step.drive.samples.data for step in lab.recorder.read("parent", iterator_pb2.IterationStep)]
    finally:
        lab.recorder.steps["child"] = whole


@pytest.mark.parametrize("kept", [None, 5])
def test_copies_that_the_parent_does_not_hold_any_more_are_told_before_anything_moves(lab, kept):
    parent, child = lab.recorder.steps["parent"], lab.recorder.steps["child"]
    lab.recorder.steps["child"] = child[:4]
    del lab.recorder.steps["parent"]
    if kept:
        lab.recorder.steps["parent"] = parent[:kept]
    try:
        with pytest.raises(FaultError, match=r"takes over 2 playbacks of 'parent' and its recording holds 0") as caught:
            lab.resume("child")
        assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "id")
        assert lab.recorder.kinds("child") == [kind for kind, _ in child[:4]]
    finally:
        lab.recorder.steps |= {"parent": parent, "child": child}


def test_what_ended_while_it_was_taking_over_needs_nothing_of_its_parent():
    ended = recorded(iterator_pb2.CAMPAIGN_PHASE_STOPPED)
    ended.spec.parent, ended.spec.parent_iteration = "zeroth", 5
    assert not lacks_copies(ended)
    assert same_campaign(ended).copies == ()


def test_what_was_told_of_a_playback_is_told_again_where_it_is_not_made_again(lab):
    target = np.vstack([noise_target(8000, level=(9e4, 40.0)), np.zeros(8000)])
    spec = specification("held", target=target, iterations=ITERATIONS)
    spec.limit_policy, spec.largest_overrun = iterator_pb2.LIMIT_POLICY_PROJECT, 20.0
    lab.start(spec)
    told = list(lab.end_of("held").remarks)
    assert any(remark.startswith("Playback 1: ") for remark in told)
    assert any(remark.startswith("Playback 2: ") for remark in told)
    # Broken off after its second playback.
    lab.recorder.steps["held"] = lab.recorder.steps["held"][: 3 + 3 + 2 * 3]
    lab.resume("held")
    assert list(lab.end_of("held").remarks) == told
    lab.resume("held", new_id="held-2", from_iteration=2)
    assert list(lab.end_of("held-2").remarks) == told


def test_a_campaign_of_the_longest_id_can_name_all_its_runs(lab):
    id = "a" * 104
    spec = specification(id, iterations=1)
    spec.confirmations = 1
    lab.start(spec)
    final = lab.end_of(id)
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED, final.fault.message
    named = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlanned)]
    assert named == [f"{id}.identify", f"{id}.i01", f"{id}.confirm01"]
    # The longest there is: of the last playback that can be asked for, after 998 crashes in it.
    assert check_run(run_name(f"{id}.i{2**32 - 1}", tuple(f"{id}.i{2**32 - 1}-{k}" for k in range(998))))
