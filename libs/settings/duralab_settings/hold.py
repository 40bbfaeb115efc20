"""Hold points of a campaign, and the decisions at them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Final, Self

from pydantic import AfterValidator, Field, model_serializer, model_validator

from duralab_settings.iteration import ControlBandSettings, ResolvedUpdate
from duralab_settings.section import Section
from duralab_settings.values import MisfitError

_LONGEST_REASON: Final = 1000


class HoldPoint(StrEnum):
    """Playbacks before which a campaign waits for a decision."""

    NEVER = "never"
    """No hold points."""
    FIRST = "first"
    """A hold point before the first playback."""
    EACH = "each"
    """A hold point before each playback of the target."""
    PREDICTED = "predicted"
    """A hold point before each playback whose prediction exceeds a bound."""


_HeldAbove = Annotated[float, Field(gt=0, le=1e6)]


class HoldSettings(Section):
    """Hold points of a campaign: the message `duralab.v1.HoldSettings`; in a file a word or bounds."""

    when: HoldPoint = Field(strict=False, description="Playbacks before which the campaign waits.")
    predicted_peak: _HeldAbove | None = Field(
        default=None, description="Largest predicted peak of a response over its target's; the campaign waits above it."
    )
    predicted_damage: _HeldAbove | None = Field(
        default=None,
        description="Wait where a response's predicted damage over its target's passes this, at stop.damage_exponent.",
    )

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, given: Any) -> Any:
        if isinstance(given, str) and given in tuple(HoldPoint):
            return {"when": given}
        if not isinstance(given, dict | HoldSettings):
            raise ValueError(f"is {given!r}; give never, first, each, or predicted_peak, predicted_damage or both")
        return {"when": HoldPoint.PREDICTED, **given} if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        bounded = self.predicted_peak is not None or self.predicted_damage is not None
        if bounded != (self.when is HoldPoint.PREDICTED):
            found = f"waits {self.when.value} and has bounds" if bounded else "has no bound"
            raise MisfitError(
                f"{found}; give never, first, each, or predicted_peak, predicted_damage or both", field="when"
            )
        return self

    @model_serializer
    def _as_in_file(self) -> Any:
        bounds = {"predicted_peak": self.predicted_peak, "predicted_damage": self.predicted_damage}
        given = {key: value for key, value in bounds.items() if value is not None}
        return given or self.when.value


class DecisionKind(StrEnum):
    """Kind of a decision at a hold point."""

    PLAY = "play"
    """The drive of the proposal is played."""
    CHANGE = "change"
    """The drive is computed again with other settings, from this playback on."""
    BACK = "back"
    """The drive is computed again from an earlier playback."""
    END = "end"
    """The campaign ends without further playbacks."""


def _said(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError(f"is {text[:80]!r}; give printable characters on one line, not only blanks")
    return text


class Decision(Section):
    """Decision on a proposal, as given by a person: the message `duralab.v1.Decision`."""

    proposal: int = Field(ge=1, lt=2**32, description="Number of the proposal.")
    kind: DecisionKind = Field(strict=False, description="Decision.")
    name: Annotated[str, AfterValidator(_said)] = Field(max_length=80, description="Name of the person who decides.")
    reason: Annotated[str, AfterValidator(_said)] = Field(
        max_length=_LONGEST_REASON, description="Reason of the decision."
    )
    update: ResolvedUpdate | None = Field(default=None, description="Change: new settings of the update.")
    control_band: ControlBandSettings | None = Field(default=None, description="Change: new control band.")
    from_iteration: int = Field(
        default=0, ge=0, lt=2**32, description="Back: the playback that the next drive is made from."
    )
    scenario: str = Field(default="", description="Change: the campaign file with the new settings.")

    @model_validator(mode="after")
    def _check_kind(self) -> Self:
        changes = self.update is not None or self.control_band is not None
        if changes != (self.kind is DecisionKind.CHANGE) or (self.scenario and not changes):
            raise MisfitError(
                f"has the kind {self.kind.value} {'and' if changes else 'without'} other settings; update, "
                "control_band and scenario belong to change, which needs one of the first two",
                field="kind" if changes else "update",
            )
        if (self.from_iteration > 0) != (self.kind is DecisionKind.BACK):
            raise MisfitError(
                f"has the kind {self.kind.value} and from_iteration {self.from_iteration}; back, and no other kind, "
                "names a playback from 1",
                field="from_iteration",
            )
        return self
