"""The sections `update` and `stop` of a campaign file: how each next drive is made, and when the iteration ends."""

from __future__ import annotations

from enum import IntEnum, StrEnum
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from duralab.campaign.values import Gain, GainPerChannel, NotNegative, Positive, Section

Bound = Annotated[float, Field(gt=1.0, allow_inf_nan=False)]
"""Multiple of the target's figure that no playback may pass."""


class Algorithm(StrEnum):
    """How each next drive is made."""

    SECANT = "secant"
    ADAPTIVE_MODELLING = "adaptive_modelling"
    BASIC_TWR = "basic_twr"


class AtLimits(StrEnum):
    """What is done with a next drive that would pass a limit of the rig."""

    REFUSE = "refuse"
    PROJECT = "project"


class Prediction(StrEnum):
    """What Adaptive Modelling compares."""

    FORWARD = "forward"
    BACKWARD = "backward"


class CorrectionShape(StrEnum):
    """Which elements of a correction Adaptive Modelling estimates."""

    DIAGONAL = "diagonal"
    FULL = "full"


class DamageExponent(IntEnum):
    """Slopes of the S-N lines that damage is judged at."""

    THREE = 3
    FIVE = 5
    EIGHT = 8


class GainPoint(Section):
    """A point of the gain over frequency."""

    frequency: NotNegative = Field(description="In hertz.")
    share: GainPerChannel = Field(description="Share of the gain there, above 0 to 1: one, or one for each response.")


class ResponseGroup(Section):
    """Responses that share a gain, a weight or both."""

    channels: tuple[str, ...] = Field(min_length=1, strict=False, description="Which responses.")
    gain: Gain | None = Field(default=None, description="Takes the place of the update's gain for them.")
    weight: Positive | None = Field(default=None, description="How much each counts beside the other responses.")

    @model_validator(mode="after")
    def _check_what_is_shared(self) -> Self:
        if self.gain is None and self.weight is None:
            raise ValueError("has channels and neither gain nor weight; name what they share")
        return self


class UpdateSection(Section):
    """How each next drive is made from the error of the playbacks so far."""

    algorithm: Algorithm = Field(default=Algorithm.SECANT, strict=False, description="The update of the drive.")
    gain: GainPerChannel = Field(
        description="Share of the error that a playback corrects, above 0 to 1: one number, or one for each response."
    )
    gain_schedule: tuple[Gain, ...] = Field(
        default=(),
        strict=False,
        description="Shares of the gain for the first drive, the second and so on, e.g. [0.7, 1.0]; the last holds on.",
    )
    gain_curve: tuple[GainPoint, ...] = Field(
        default=(), strict=False, description="Shares of the gain over frequency, straight lines between points."
    )
    watch: tuple[str, ...] = Field(
        default=(),
        strict=False,
        description="Responses that are told, but not controlled or judged; their target may be silent or missing.",
    )
    weights: dict[str, Positive] = Field(
        default_factory=dict,
        description="How much a response counts beside the others where there are more than drives; left out: 1.",
    )
    groups: dict[str, ResponseGroup] = Field(
        default_factory=dict, description="Responses that share a gain, a weight or both, under a name of your own."
    )
    accept_segments: bool | None = Field(
        default=None,
        description="Start each drive from the best so far, stretch by stretch, and step less where it got worse; left "
        "out: true for secant only.",
    )
    smallest_correction: float = Field(default=0.5, gt=0, le=1, description="Least factor on the inverse model.")
    largest_correction: float = Field(default=2.0, ge=1, le=100, description="Greatest factor on the inverse model.")
    weigh_by_coherence: bool = Field(
        default=True, description="Correct less where the response is not what the model foresees."
    )
    lowest_coherence: float = Field(
        default=0.7,
        ge=0,
        lt=1,
        description="Coherence of measured with foreseen response below which nothing is corrected.",
    )
    prediction: Prediction = Field(
        default=Prediction.FORWARD, strict=False, description="Correct the responses' side of the model or the drives'."
    )
    correction: CorrectionShape = Field(
        default=CorrectionShape.DIAGONAL, strict=False, description="Correct channel by channel or all with each other."
    )
    forgetting: float = Field(
        default=0.7, ge=1e-3, le=1, description="Secant: weight of a step relative to the one after it."
    )
    prior_strength: float = Field(default=1.0, ge=1e-6, le=1e6, description="Secant: weight of the identified model.")
    caution: float = Field(
        default=1.0, ge=0, le=1e6, description="Secant: share of the model's uncertainty that is minded."
    )
    regularisation: float = Field(
        default=1e-5, ge=0, le=1e6, description="Secant: of the inverse, relative to the model."
    )

    @property
    def accepts_segments(self) -> bool:
        """Whether each drive starts from the best so far, stretch by stretch."""
        return self.algorithm is Algorithm.SECANT if self.accept_segments is None else self.accept_segments

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        frequencies = [point.frequency for point in self.gain_curve]
        if any(after <= before for before, after in pairwise(frequencies)):
            raise ValueError(f"has a gain_curve at {frequencies} Hz; the frequencies must rise from point to point")
        return self

    @model_validator(mode="after")
    def _check_responses(self) -> Self:
        grouped = [(name, group) for group in self.groups.values() for name in group.channels]
        weighted = [name for name, group in grouped if group.weight is not None]
        for what, names in (
            ("in watch or in weights, or in a group with a weight,", [*self.watch, *self.weights, *weighted]),
            ("in a group", [name for name, _ in grouped]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"has {', '.join(twice)} {what} twice; once is enough")
        return self


class StopSection(Section):
    """When the iteration ends."""

    iterations: int = Field(ge=1, le=1000, description="Most playbacks of the target.")
    relative_rms_error: NotNegative = Field(
        default=0.0, description="End when every channel's relative RMS error is at most this; 0: not asked."
    )
    divergence_ratio: NotNegative = Field(
        default=0.0, description="End when a channel's error exceeds this multiple of its best; 0: never."
    )
    damage_ratio: tuple[NotNegative, Positive] | None = Field(
        default=None,
        strict=False,
        description="End only when every channel's damage, response over target, lies between, e.g. [0.8, 1.25].",
    )
    damage_exponent: DamageExponent = Field(
        default=DamageExponent.FIVE, strict=False, description="Slope of the S-N line: 3, 5 or 8."
    )
    damage_budget: NotNegative = Field(
        default=0.0, description="End before the specimen took this multiple of the target's damage; 0: no limit."
    )
    error_bound: Bound | None = Field(
        default=3.0,
        description="End the campaign where a playback's relative RMS error of a channel passes this, measured or "
        "predicted by the model; a rig at rest has 1; null: no bound.",
    )
    peak_bound: Bound | None = Field(
        default=3.0, description="The same for a channel's peak over the target's; null: no bound."
    )
    damage_bound: Bound | None = Field(
        default=250.0,
        description="The same for a channel's damage in one playback over the target's, at damage_exponent; null: no "
        "bound.",
    )
    smallest_improvement: float = Field(
        default=0.0, ge=0, lt=1, description="End when the last playbacks did not lower the best error by this share."
    )
    improvement_playbacks: int = Field(default=2, ge=1, le=1000, description="How many playbacks those are.")

    @model_validator(mode="after")
    def _check_damage_ratio(self) -> Self:
        if self.damage_ratio is not None and not self.damage_ratio[0] < 1.0 < self.damage_ratio[1]:
            raise ValueError(f"has damage_ratio {list(self.damage_ratio)}; the first must be below 1, the second above")
        return self
