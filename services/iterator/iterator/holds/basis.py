"""Basis of updates and judgements: that of the campaign until a decision at a hold point changes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from iterator.model import RigModel
from iterator.playbacks import CampaignSettings
from iterator.updates import controlled_model, controlled_responses, controlled_settings


@dataclass(frozen=True, eq=False)
class Basis:
    """Target, model and settings of a campaign.

    `target`, shape (n_y, samples): In the control band. `identified`: Model of all responses, before an update corrects
    it. `settings`: Settings of the updates and the end. `identification_damage`, shape (n_y, exponents): Damage spent
    by the identification, in passes of the target. `target_damage`, shape (n_y, exponents): Pseudo-damage of one pass
    of the target as measured.
    """

    target: NDArray[np.float64]
    identified: RigModel
    settings: CampaignSettings
    identification_damage: NDArray[np.float64] | None = None
    target_damage: NDArray[np.float64] | None = None

    @cached_property
    def controlled(self) -> NDArray[np.bool_]:
        """Mask of the controlled responses, shape (n_y,)."""
        return controlled_responses(self.identified)

    @cached_property
    def controlled_target(self) -> NDArray[np.float64]:
        """Target of the controlled responses."""
        return self.rows(self.target)

    @cached_property
    def model(self) -> RigModel:
        """Identified model of the controlled responses."""
        return controlled_model(self.identified, self.controlled)

    @cached_property
    def own_settings(self) -> CampaignSettings:
        """Settings with the update of the controlled responses."""
        update = controlled_settings(self.settings.update, self.controlled)
        return self.settings.model_copy(update={"update": update})

    def rows(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rows of the controlled responses."""
        return samples if self.controlled.all() else np.ascontiguousarray(samples[self.controlled])

    def judges_as(self, other: Basis) -> bool:
        """Return whether the figures of both are comparable: of the same control band and the same responses."""
        same_band = self.settings.update.band == other.settings.update.band
        return same_band and np.array_equal(self.controlled, other.controlled)

    def updates_as(self, other: Basis) -> bool:
        """Return whether a model corrected under the other basis may be corrected further under this one."""
        return self.identified is other.identified and self.settings.update.kind is other.settings.update.kind
