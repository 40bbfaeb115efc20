"""Measured target of a campaign file: its channels and its edits."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from duralab_settings import Gain, NotNegative, Positive, Range, Section

Factor = Annotated[float, Field(allow_inf_nan=False)]


class SourceChannel(Section):
    """Channel of a file that is the target of a response; may be given by its name alone."""

    # The key in the file is `from`, a reserved word in Python.
    model_config = ConfigDict(serialize_by_alias=True)

    source: str = Field(alias="from", min_length=1, description="Name of the channel in the file, e.g. FZ_FL.")
    unit: str | None = Field(
        default=None,
        min_length=1,
        description="Unit of the values in the file, e.g. kN; left out: the unit that the file names.",
    )
    scale: Factor = Field(
        default=1.0, description="Factor on the values, e.g. -1 for an axis in the opposite direction."
    )

    @model_validator(mode="before")
    @classmethod
    def _take_a_name(cls, value: Any) -> Any:
        return {"from": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _check_scale(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("has scale 0, which leaves nothing; leave the response out, or give another factor")
        return self


class Stretch(Section):
    """Part of the target."""

    model_config = ConfigDict(serialize_by_alias=True)

    start: NotNegative = Field(default=0.0, alias="from", description="Start of the part to keep, in seconds.")
    end: Positive | None = Field(
        default=None, alias="to", description="End of the part to keep, in seconds; left out: the end of the target."
    )

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.end is not None and self.start >= self.end:
            raise ValueError(f"goes from {self.start:g} to {self.end:g} s; from must be below to")
        return self


class RemoveMean(Section):
    """Remove the mean."""

    channels: tuple[str, ...] = Field(default=(), strict=False, description="Channels that are edited; left out: all.")


class RemoveDrift(Section):
    """Remove a slow polynomial, and keep the mean."""

    order: int = Field(default=1, ge=1, le=9, description="Order of the polynomial; 1 is a straight line.")
    channels: tuple[str, ...] = Field(default=(), strict=False, description="Channels that are edited; left out: all.")


class Filter(Section):
    """Butterworth filter, forward and backward: no phase shift, and half the amplitude at a corner."""

    low_pass: Positive | None = Field(default=None, description="Low-pass: upper cut-off frequency, in hertz.")
    high_pass: Positive | None = Field(default=None, description="High-pass: lower cut-off frequency, in hertz.")
    band_pass: Range | None = Field(
        default=None, strict=False, description="Band-pass: lower and upper cut-off frequency, in hertz."
    )
    band_stop: Range | None = Field(
        default=None, strict=False, description="Band-stop: lower and upper cut-off frequency, in hertz."
    )
    order: int = Field(
        default=4,
        ge=1,
        le=12,
        description="Order of the filter in one pass; it runs forward and backward, so the slope is that of "
        "twice the order.",
    )
    channels: tuple[str, ...] = Field(default=(), strict=False, description="Channels that are edited; left out: all.")

    @model_validator(mode="after")
    def _check_one_kind(self) -> Self:
        kinds = ("low_pass", "high_pass", "band_pass", "band_stop")
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"has {' and '.join(given) if given else 'none'} of {', '.join(kinds)}; one is needed")
        for name in given:
            corners = getattr(self, name)
            if isinstance(corners, tuple) and corners[0] >= corners[1]:
                raise ValueError(f"has {name} [{corners[0]:g}, {corners[1]:g}]; the first must be below the second")
        return self

    @property
    def kind(self) -> tuple[str, tuple[float, ...]]:
        """Kind of the filter, and its corners in hertz."""
        if self.low_pass is not None:
            return "low_pass", (self.low_pass,)
        if self.high_pass is not None:
            return "high_pass", (self.high_pass,)
        return ("band_pass", self.band_pass) if self.band_pass is not None else ("band_stop", self.band_stop or ())


class Resample(Section):
    """Change the sample rate; frequencies above half the new rate are removed."""

    rate: Positive = Field(description="Sample rate of the rig, in hertz.")


class Despike(Section):
    """Find single wrong samples and replace them by a smooth curve."""

    longest: Positive = Field(default=0.003, description="Largest width of a spike, at half its height, in seconds.")
    threshold: Positive = Field(
        default=10.0, description="Height of the lowest spike, in standard deviations of the signal around it."
    )
    channels: tuple[str, ...] = Field(default=(), strict=False, description="Channels that are edited; left out: all.")


class TaperLevel(StrEnum):
    """Level at the begin and the end of a tapered target."""

    MEAN = "mean"
    ZERO = "zero"


class Taper(Section):
    """Fade the target in and out."""

    seconds: Positive = Field(description="Length of the fade at either end.")
    to: TaperLevel = Field(
        default=TaperLevel.MEAN,
        strict=False,
        description="Level that the fade starts from: the mean of each channel, or zero, which also fades "
        "static loads.",
    )


class Segment(Stretch):
    """Part of the target, once or repeated."""

    repeat: int = Field(default=1, ge=1, le=10_000, description="Number of times that the part is repeated.")


class Join(Section):
    """Join parts of the target, in the given order."""

    segments: tuple[Segment, ...] = Field(strict=False, min_length=1, description="Parts, in this order.")
    cross_fade: NotNegative = Field(default=0.2, description="Duration of the cross-fade between parts, in seconds.")


class ShortenByDamage(Section):
    """Keep the sections that contain the damage of any channel."""

    keep: Gain = Field(description="Smallest share of each channel's pseudo-damage to keep, e.g. 0.95.")
    exponent: Positive = Field(default=5.0, le=20, description="Slope of the S-N line.")
    window: Positive = Field(
        default=1.0, description="Length of a window, in seconds; each kept section is a whole number of windows."
    )
    cross_fade: NotNegative = Field(default=0.2, description="Duration of the cross-fade between sections, in seconds.")


EditSettings = Stretch | RemoveMean | RemoveDrift | Filter | Resample | Despike | Taper | Join | ShortenByDamage


class EditStep(Section):
    """One step of editing; a step without settings may be given by its name alone."""

    cut: Stretch | None = Field(default=None, description="Keep one part.")
    remove_mean: RemoveMean | None = Field(default=None, description="Remove the mean.")
    remove_drift: RemoveDrift | None = Field(default=None, description="Remove a polynomial trend.")
    filter: Filter | None = Field(default=None, description="Zero-phase filter.")
    resample: Resample | None = Field(default=None, description="Resample to another sample rate.")
    despike: Despike | None = Field(default=None, description="Replace single wrong samples.")
    taper: Taper | None = Field(default=None, description="Fade in and out.")
    join: Join | None = Field(default=None, description="Join parts.")
    shorten_by_damage: ShortenByDamage | None = Field(default=None, description="Keep the parts that carry the damage.")

    @model_validator(mode="before")
    @classmethod
    def _take_a_name(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {value: {}}
        if isinstance(value, Mapping):
            return {key: {} if settings is None else settings for key, settings in value.items()}
        return value

    @model_validator(mode="after")
    def _check_one_step(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"has {' and '.join(given) if given else 'no step'}; each entry of the list holds one of "
                f"{', '.join(type(self).model_fields)}"
            )
        return self

    @property
    def name(self) -> str:
        """Name of the step in the file."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None)

    @property
    def settings(self) -> EditSettings:
        """Settings of the step."""
        return getattr(self, self.name)
