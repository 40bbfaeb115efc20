"""What the values of a campaign file may be, and what every section of it has in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Gain = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Levels = tuple[Gain, ...]
Range = tuple[Positive, Positive]
Seed = Annotated[int, Field(ge=0, lt=2**63)]

ONE_NUMBER, PER_CHANNEL = "one number", "per channel"
"""The two ways to give a value of every channel; they stand in pydantic's locations, never in the file."""

_how_given = Discriminator(lambda value: PER_CHANNEL if isinstance(value, dict) else ONE_NUMBER)
PositivePerChannel = Annotated[
    Annotated[Positive, Tag(ONE_NUMBER)] | Annotated[dict[str, Positive], Tag(PER_CHANNEL)], _how_given
]
GainPerChannel = Annotated[Annotated[Gain, Tag(ONE_NUMBER)] | Annotated[dict[str, Gain], Tag(PER_CHANNEL)], _how_given]


class Section(BaseModel):
    """A part of the file: every key is known and has its type; nothing is guessed."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
