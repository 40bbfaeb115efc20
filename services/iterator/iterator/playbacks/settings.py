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
        Settings of the update: kind, control band, gains and safeguards.
    stop : StopCriteria
        Criteria of the end.

    Raises
    ------
    ValueError
        A value is not allowed, or the levels leave no playback at full level.
    """

    # A notebook requests projection by name; it is the default of a campaign file.
    limit_policy: LimitPolicy = LimitPolicy.REFUSE
    update: InstanceOf[UpdateSettings]
    stop: InstanceOf[StopCriteria]

    @model_validator(mode="after")
    def _check_whole_playback(self) -> Self:
        self.require_whole_playback(self.stop)
        return self
