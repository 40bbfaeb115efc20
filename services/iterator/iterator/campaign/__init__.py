"""A campaign on the bus: its checks, its steps, its recording and its status."""

from iterator.campaign.admission import (
    expect_free_id,
    go_on_recording,
    read_parent,
    require_id,
    require_name,
    require_same_rig,
)
from iterator.campaign.campaign import Campaign
from iterator.campaign.identification import check_at_target, identification_request, identification_run
from iterator.campaign.known_before import known_experiment, read_known_before
from iterator.campaign.messages import checked_model
from iterator.campaign.plan import drive_limits, plan_campaign
from iterator.campaign.recorded import RecordedCampaign, read_campaign
from iterator.campaign.resumption import (
    Resumption,
    finished_unseen,
    lacks_copies,
    new_campaign,
    require_no_settings,
    same_campaign,
)
from iterator.campaign.static_part import static_response_of
from iterator.campaign.status_board import CampaignBoard, is_final

__all__ = [
    "Campaign",
    "CampaignBoard",
    "RecordedCampaign",
    "Resumption",
    "check_at_target",
    "checked_model",
    "drive_limits",
    "expect_free_id",
    "finished_unseen",
    "go_on_recording",
    "identification_request",
    "identification_run",
    "is_final",
    "known_experiment",
    "lacks_copies",
    "new_campaign",
    "plan_campaign",
    "read_campaign",
    "read_known_before",
    "read_parent",
    "require_id",
    "require_name",
    "require_no_settings",
    "require_same_rig",
    "same_campaign",
    "static_response_of",
]
