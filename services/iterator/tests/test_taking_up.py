"""What may be taken up again under a new name when all playbacks are made."""

from __future__ import annotations

import pytest

from duralab_proto.v1 import identifier_pb2, iterator_pb2
from iterator.campaign_resumption import new_campaign
from iterator.recorded_campaign import RecordedCampaign
from labbus import FaultError


def recorded(phase: iterator_pb2.CampaignPhase | None) -> RecordedCampaign:
    """A campaign of three playbacks, all made; its last status where it got to write one."""
    spec = iterator_pb2.CampaignSpec(id="first")
    spec.stop.largest_iterations = 3
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
    assert len(resumption.iterations) == spec.stop.largest_iterations == 3


def test_what_is_finished_needs_more_playbacks_to_be_taken_up():
    request = iterator_pb2.ResumeCampaignRequest(new_id="second")
    with pytest.raises(FaultError, match="counts the 3 playbacks"):
        new_campaign(recorded(iterator_pb2.CAMPAIGN_PHASE_FINISHED), request)
