"""Requests of a browser: the values of each command, checked before use."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from operator_page.accounts import LONGEST_PASSWORD, NAME_PATTERN

CAMPAIGN_NAME = r"^[a-z0-9][a-z0-9_-]{0,59}$"


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"is {text[:80]!r}; give printable characters on one line")
    return text


Said = Annotated[str, StringConstraints(strip_whitespace=True, max_length=500)]
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500)]
# It is part of every state of the rig.
ResetReason = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=300), AfterValidator(_printable)
]


class Values(BaseModel):
    """Values of a command."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Nothing(Values):
    """A command without values."""


class SignIn(Values):
    """Name and password of a person."""

    name: Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
    password: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST_PASSWORD)]


class Stop(Values):
    """Reason of a stop; optional."""

    reason: Said = ""


class Reset(Values):
    """Reason of a reset."""

    reason: ResetReason


class PreTest(Values):
    """Level of a pre-test as a share of the limits."""

    level: float = Field(default=0.05, gt=0.0, le=0.05)


class Begin(Values):
    """Campaign to begin: a shipped one, or a file of the page's folder; `rigs`: Rigs shown to the person."""

    kind: Literal["shipped", "file"]
    name: Annotated[str, StringConstraints(pattern=CAMPAIGN_NAME)]
    rigs: list[str] | None = None


class Decide(Values):
    """A decision at a hold point."""

    kind: Literal["play", "change", "back", "end"]
    proposal: int = Field(ge=1, lt=2**32)
    reason: Reason
    settings: dict[str, Any] | None = None
    from_iteration: int = Field(default=0, ge=0, lt=2**32)


class Resume(Values):
    """Playback from which a campaign continues; 0 is the last."""

    from_iteration: int = Field(default=0, ge=0, lt=2**32)


class Arm(Values):
    """First of two acts: the action and its values."""

    action: Annotated[str, StringConstraints(pattern=r"^/api/[a-z0-9_/-]{1,250}$")]
    values: dict[str, Any]


class CampaignDocument(Values):
    """A campaign in the form of its file; saved if `save`, also over an existing one if `replace`."""

    document: dict[str, Any]
    save: bool = False
    replace: bool = False


class BeginEndurance(Values):
    """Endurance test to begin: a schedule file of the page's folder; `rigs`: Rigs shown to the person."""

    name: Annotated[str, StringConstraints(pattern=CAMPAIGN_NAME)]
    rigs: list[str] | None = None
    seed: int = Field(default=0, ge=0, lt=2**63)
    real_time: bool = False


class StopEndurance(Values):
    """Reason of a hold or an end of an endurance test."""

    reason: Reason


class DecideEndurance(Values):
    """A decision on a hold of an endurance test."""

    kind: Literal["continue", "iterate_again", "relearn", "end"]
    hold: int = Field(ge=1, lt=2**32)
    reason: Reason


class ScheduleDocument(CampaignDocument):
    """A schedule in the form of its file; a drive is a file of the page's folder or the id of a recording."""
