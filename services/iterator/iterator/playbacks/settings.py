"""Settings of update and stop criteria."""

from __future__ import annotations

from typing import Self

from pydantic import InstanceOf, model_validator

from duralab_settings import LimitPolicy, PlaybackSettings, StopCriteria
from iterator.updates import UpdateSettings


class CampaignSettings(PlaybackSettings):
    """Settings of update and stop criteria; the other fields are those of `PlaybackSettings`.

    Parameters
    ----------
    update : UpdateSettings
        Kind, control band, gains and safeguards.
    stop : StopCriteria
        When to end.

    Raises
    ------
    ValueError
        A value is not allowed, or the levels leave no playback at full level.
    """

    # A notebook asks for projection by name; a campaign file has it by default.
    limit_policy: LimitPolicy = LimitPolicy.REFUSE
    update: InstanceOf[UpdateSettings]
    stop: InstanceOf[StopCriteria]

    @model_validator(mode="after")
    def _check_whole_playback(self) -> Self:
        self.require_whole_playback(self.stop)
        return self
