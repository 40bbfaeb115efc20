"""Start of a campaign from earlier results: a model, a first drive, playbacks of other campaigns, a section."""

from __future__ import annotations

from typing import Self

from pydantic import ConfigDict, Field, model_validator

from duralab_settings import NotNegative, Positive, Section


class FirstSection(Section):
    """Section of the target on which a separate campaign iterates before the whole target."""

    model_config = ConfigDict(serialize_by_alias=True)

    start: NotNegative = Field(default=0.0, alias="from", description="Start of the section, in seconds.")
    end: Positive = Field(alias="to", description="End of the section, in seconds.")
    iterations: int = Field(ge=1, le=1000, description="Largest number of playbacks of the section.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.start >= self.end:
            raise ValueError(f"goes from {self.start:g} to {self.end:g} s; from must be below to")
        return self


_RECORDING = "the path of a recording.mcap, or the id of a campaign in the lab"


class StartFrom(Section):
    """Earlier results that are used before the first playback."""

    model: str | None = Field(
        default=None,
        min_length=1,
        description=f"Recording with the model of this rig: {_RECORDING}; its excitation and estimator replace "
        "those of the campaign. Left out: the rig is identified.",
    )
    model_age: Positive | None = Field(
        default=None, le=87600, description="Largest age of the model, in hours; left out: no limit."
    )
    drive: str | None = Field(
        default=None,
        min_length=1,
        description=f"First drive: {_RECORDING}, whose best drive the model scales to the target; or a file of "
        "drives, played as they are. No longer than the target.",
    )
    learn_from: tuple[str, ...] = Field(
        default=(),
        strict=False,
        max_length=100,
        description=f"Campaigns of this very rig whose playbacks the update learns from, in this order: {_RECORDING}.",
    )
    section: FirstSection | None = Field(
        default=None,
        description="A section of the target that is iterated first, e.g. {from: 2, to: 8, iterations: 3}.",
    )

    @model_validator(mode="after")
    def _check_age(self) -> Self:
        if self.model_age is not None and self.model is None:
            raise ValueError(f"has model_age {self.model_age:g} and no model whose age it limits; name the model")
        if self.section is not None and self.drive is not None:
            raise ValueError("has a section and a drive; the section makes the first drive, so leave the drive out")
        return self
