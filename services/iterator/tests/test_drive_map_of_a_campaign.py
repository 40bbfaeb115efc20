"""What a campaign makes of the drive map that its model has, or has not."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2
from iterator import MapFromFirstPlayback
from iterator.campaign import identification_request, new_campaign, plan_campaign
from iterator.campaign.messages import checked_drive_map
from iterator.campaign.recorded import RecordedCampaign
from iterator.campaign.remarks import map_remarks
from iterator.model import RigModel

from .linear_rig import description, experiment_plan, specification


def planned(*, learn=True):
    spec = specification("campaign", rig="linear")
    spec.update.drive_map.learn = learn
    return plan_campaign(spec, description("linear"), experiment_plan(spec))


def start(plan, *, highest=None):
    frequency = np.linspace(0.0, plan.description.sample_rate / 2.0, 257)
    end = plan.identified_band[1] if highest is None else highest
    drives, responses = len(plan.description.drives), len(plan.description.responses)
    frf = np.zeros((257, responses, drives), dtype=complex)
    lines = np.flatnonzero((frequency > 0.0) & (frequency <= end))
    return RigModel(frequency, frf, frf.transpose(0, 2, 1), slice(int(lines[0]), int(lines[-1]) + 1))


def model(plan, *, follower=1, highest=None, scale=0.01):
    end = plan.identified_band[1] if highest is None else highest
    message = identifier_pb2.Model()
    message.drive_map.scale.CopyFrom(to_array(np.full(len(plan.description.drives), scale)))
    message.drive_map.highest_frequency = end
    message.drive_map.terms.add(follower=follower, coefficients=to_array(np.array([0.1, 0.0, 0.0])))
    return message


def test_a_map_is_asked_for_with_the_weights_of_the_responses():
    plan = planned()
    request = identification_request(plan.spec, run="r", check_only=False, map_weight=plan.map_weight)
    np.testing.assert_array_equal(from_array(request.drive_map.response_weight), plan.response_weight)
    without = planned(learn=False)
    assert without.map_weight is None
    request = identification_request(without.spec, run="r", check_only=False, map_weight=without.map_weight)
    assert not request.HasField("drive_map")


def test_the_map_of_the_model_is_learned_again_and_one_is_learned_later_where_it_has_none():
    plan = planned()
    drives = plan.limits.names, plan.limits.units
    displaced = tuple(drive.kind == array_pb2.CHANNEL_KIND_DISPLACEMENT for drive in plan.description.drives)
    # A correction starts near the playback that the map is for.
    found = checked_drive_map(model(plan), start(plan), plan=plan, corrects=True)
    assert [(term.follower, term.product) for term in found.terms] == [(1, (0, 0))]
    assert found.names == plan.limits.names
    again = checked_drive_map(model(plan), start(plan), plan=plan)
    assert again == MapFromFirstPlayback(*drives, may_follow=displaced, start=found)
    without_terms = model(plan)
    del without_terms.drive_map.terms[:]
    assert checked_drive_map(without_terms, start(plan), plan=plan).is_identity
    later = checked_drive_map(identifier_pb2.Model(), start(plan), plan=plan)
    assert later == MapFromFirstPlayback(*drives, may_follow=displaced)
    without = planned(learn=False)
    assert checked_drive_map(identifier_pb2.Model(), start(without), plan=without) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"follower": 0}, "The drive map is of no use: .* close a cycle"),
        ({"scale": 0.0}, "must be finite and above 0"),
        ({"highest": 1e6}, "at most at 0.45 of the sample rate"),
    ],
)
def test_a_map_that_is_of_no_use_is_refused(change, said):
    plan = planned()
    with pytest.raises(FaultError, match=said):
        checked_drive_map(model(plan, **change), start(plan), plan=plan)


def test_a_map_above_the_models_band_is_refused():
    plan = planned()
    with pytest.raises(FaultError, match="learn the map of the same identification as the model"):
        checked_drive_map(model(plan), start(plan, highest=0.5 * plan.identified_band[1]), plan=plan)


def test_a_model_with_a_map_cannot_be_resumed_without_it():
    plan = planned()
    recorded = RecordedCampaign(spec=plan.spec, model=model(plan), iterations=[iterator_pb2.IterationStep(iteration=1)])
    request = iterator_pb2.ResumeCampaignRequest(new_id="again")
    request.update.CopyFrom(plan.spec.update)
    request.update.drive_map.learn = False
    with pytest.raises(FaultError, match=r"the model of campaign .* goes with its drive map; leave the key out"):
        new_campaign(recorded, request)
    request.update.ClearField("drive_map")
    new_campaign(recorded, request)


def test_a_remark_has_the_source_of_a_map():
    drive_map = identifier_pb2.DriveMap(remarks=["The term is not chosen."])
    assert map_remarks(drive_map) == ["The term is not chosen."]
    drive_map.terms.add(sentence="lateral follows −1.7 /m × vertical²")
    said = "lateral follows −1.7 /m × vertical²."
    assert map_remarks(drive_map)[0] == f"Drive map learned from the identification: {said}"
    assert map_remarks(drive_map, source="playback 1")[0] == f"Drive map learned from playback 1: {said}"
