"""Settings of an iteration: update, stop criteria, playbacks and acceptance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from enum import IntEnum, StrEnum
from itertools import pairwise
from math import inf
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from duralab_settings.section import Section
from duralab_settings.values import (
    AS_TUPLE,
    Gain,
    GainPerChannel,
    Gains,
    MisfitError,
    NotNegative,
    Positive,
    Ratios,
    SettingsError,
    Wire,
    per_channel,
)

Bound = Annotated[float, Field(gt=1.0)]
"""Limit of a playback as a multiple of the target's value."""


class UpdateKind(StrEnum):
    """Update of the drive."""

    BASIC_TWR = "basic_twr"
    """Basic Time Waveform Replication, Eq. 2 of the paper: a fixed inverse model."""
    ADAPTIVE_MODELLING = "adaptive_modelling"
    """The inverse model is corrected after each playback, Eqs. 12 and 13."""
    SECANT = "secant"
    """The model is fitted to all steps between playbacks, anchored at the identified one."""


class CorrectionPrediction(StrEnum):
    """Prediction with which Adaptive Modelling compares a response."""

    FORWARD = "forward"
    """Compare the response that the model predicts from the drive with the measured response."""
    BACKWARD = "backward"
    """Compare the drive that the model predicts from the response with the drive that was played."""


class CorrectionShape(StrEnum):
    """Elements of a correction that Adaptive Modelling estimates."""

    DIAGONAL = "diagonal"
    """Correct each channel separately."""
    FULL = "full"
    """Correct with a full matrix of all channels."""


class LimitPolicy(StrEnum):
    """Treatment of a next drive that would exceed a limit of the rig."""

    REFUSE = "refuse"
    """The campaign ends with a fault that states a gain that fits."""
    PROJECT = "project"
    """A similar drive within the rig's limits is played, and each change is reported."""


class DamageExponent(IntEnum):
    """Slopes of the S-N lines at which damage is judged."""

    THREE = 3
    FIVE = 5
    EIGHT = 8


class SecantSettings(Section):
    """Settings of the secant update."""

    forgetting: float = Field(default=0.7, ge=1e-3, le=1, description="Weight of a step relative to the one after it.")
    prior_strength: float = Field(default=1.0, ge=1e-6, le=1e6, description="Weight of the identified model.")
    caution: float = Field(
        default=1.0, ge=0, le=1e6, description="Share of the model's uncertainty that is taken into account."
    )
    regularisation: float = Field(
        default=1e-5, ge=0, le=1e6, description="Regularisation of the inverse, relative to the model."
    )
    odd_terms: bool = Field(
        default=True,
        description="Learn what cubes and signed squares of the drives do, and use them while they predict the "
        "playbacks better than the drives alone.",
    )
    speed_terms: bool = Field(
        default=False,
        description="Learn what the speeds of the drives do, as in dampers and friction, and use them while they "
        "predict the playbacks better than the drives alone.",
    )
    rate_limits: bool = Field(
        default=True,
        description="Learn at which speed an actuator stops following its drive, and begin its motion earlier in "
        "stretches with a large error.",
    )
    whole_record: bool = Field(
        default=False,
        description="Fit each frequency line to the finer lines of the whole record around it, not to averaged blocks: "
        "follows a rig that differs much from its identified model.",
    )


class DriveMapSettings(Section):
    """Settings of mapped drives, which follow the arcs of the rig."""

    learn: bool = Field(
        default=True,
        description="Learn from the identification, and again from the first playback, which drives follow products "
        "of others, as on the arc of an arm; a rig without arcs keeps its drives as they are.",
    )


def _as_json(given: Any) -> Any:
    """Return the settings of a plug-in as one JSON text with sorted keys."""
    try:
        content = json.loads(given) if isinstance(given, str) and given else given or {}
        text = json.dumps(content, sort_keys=True, allow_nan=False, separators=(", ", ": "))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"cannot be written as JSON: {error}; give names with numbers, texts, lists or null"
        ) from error
    if not isinstance(content, dict):
        raise ValueError(f"is {given!r}; give names with values")
    return text


class UpdatePlugin(Section):
    """Update of a plug-in of the iterator, instead of `kind`."""

    name: str = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*$",
        description="Name of its entry point in the group duralab.updates.",
    )
    settings: Annotated[
        str, BeforeValidator(_as_json, json_schema_input_type=dict[str, Any]), Field(max_length=65536)
    ] = Field(default="{}", description="Names and values of the plug-in's own settings.", validate_default=False)


class UpdateMethod(Section):
    """Update, independent of the rig."""

    kind: UpdateKind = Field(default=UpdateKind.SECANT, strict=False, description="Kind of update.")
    gain_schedule: Gains = Field(
        default=(),
        description="Shares of the gain for the first drive, the second and so on, e.g. [0.7, 1.0]; the last "
        "one is kept.",
    )
    smallest_correction: float = Field(default=0.5, gt=0, le=1, description="Least factor on the inverse model.")
    largest_correction: float = Field(default=2.0, ge=1, le=100, description="Greatest factor on the inverse model.")
    weigh_by_coherence: bool = Field(
        default=True, description="Correct less where the response is not what the model predicts."
    )
    lowest_coherence: float = Field(
        default=0.7,
        ge=0,
        lt=1,
        description="Coherence of measured with predicted response below which nothing is corrected.",
    )
    prediction: Annotated[CorrectionPrediction, Wire(zero=CorrectionPrediction.FORWARD)] = Field(
        default=CorrectionPrediction.FORWARD,
        strict=False,
        description="Side of the model that is corrected: responses or drives.",
    )
    correction: Annotated[CorrectionShape, Wire(zero=CorrectionShape.DIAGONAL)] = Field(
        default=CorrectionShape.DIAGONAL,
        strict=False,
        description="Correct each channel separately or with a full matrix.",
    )
    secant: SecantSettings = Field(default=SecantSettings(), description="Weights of the secant update.")
    drive_map: DriveMapSettings = Field(
        default=DriveMapSettings(), description="Change of drive coordinates after which the rig is nearly linear."
    )
    plugin: UpdatePlugin | None = Field(
        default=None, description="Your own update, which the iterator loads; it replaces kind."
    )


class ResolvedUpdate(UpdateMethod):
    """Update with one value for each response of a rig, in its order: the message `duralab.v1.UpdateSettings`."""

    iteration_gain: Gains = Field(
        min_length=1, description="Share of the error of each response that a playback corrects, above 0 to 1."
    )
    accept_segments: bool = Field(
        default=False, description="Start each segment of a drive from the best playback so far, not from the last."
    )
    gain_curve_frequency: Annotated[tuple[NotNegative, ...], AS_TUPLE, Field(min_length=1)] | None = Field(
        default=None, description="Points of the gain over frequency, in hertz, rising."
    )
    gain_curve_share: Annotated[tuple[Gains, ...], AS_TUPLE] | None = Field(
        default=None, description="Share of the gain at each point, for each response, above 0 to 1."
    )
    weights: Annotated[tuple[NotNegative, ...], AS_TUPLE] | None = Field(
        default=None, description="Weight of each response; 0: monitored only. Left out: all 1."
    )

    @model_validator(mode="before")
    @classmethod
    def _leave_out_unused(cls, given: Any) -> Any:
        # Messages for the other updates leave the bounds of a correction at 0.
        if isinstance(given, dict) and given.get("kind") != UpdateKind.ADAPTIVE_MODELLING:
            unused = ("smallest_correction", "largest_correction")
            return {key: value for key, value in given.items() if key not in unused or value != 0.0}
        return given

    @model_validator(mode="after")
    def _check_responses(self) -> Self:
        responses = len(self.iteration_gain)
        if (self.gain_curve_frequency is None) != (self.gain_curve_share is None):
            raise MisfitError(
                "has only one of gain_curve_frequency and gain_curve_share; give both or none",
                field="gain_curve_frequency",
            )
        if self.gain_curve_frequency is not None and self.gain_curve_share is not None:
            frequency, share = self.gain_curve_frequency, self.gain_curve_share
            if len(share) != len(frequency) or {len(row) for row in share} != {responses}:
                raise MisfitError(
                    f"has a gain curve of {len(frequency)} frequencies with {len(share)} rows of shares; it needs a "
                    f"row for each frequency, with one share for each of {responses} responses",
                    field="gain_curve_share",
                )
            _require_rising(frequency, field="gain_curve_frequency")
        if self.weights is not None and len(self.weights) != responses:
            raise MisfitError(
                f"has {len(self.weights)} weights and {responses} iteration gains; each response needs one of each",
                field="weights",
            )
        return self


class GainPoint(Section):
    """Point of the curve of gain over frequency."""

    frequency: NotNegative = Field(description="Frequency, in hertz.")
    share: GainPerChannel = Field(
        description="Share of the gain at this frequency, above 0 to 1: one number, or one for each response."
    )


class ResponseGroup(Section):
    """Responses that share a gain, a weight or both."""

    channels: Annotated[tuple[str, ...], AS_TUPLE] = Field(min_length=1, description="Responses of the group.")
    iteration_gain: Gain | None = Field(
        default=None, description="Iteration gain of these responses, instead of that of the update."
    )
    weight: Positive | None = Field(default=None, description="Weight of each of these responses.")

    @model_validator(mode="after")
    def _check_what_is_shared(self) -> Self:
        if self.iteration_gain is None and self.weight is None:
            raise ValueError("has channels and neither iteration_gain nor weight; name what they share")
        return self


class UpdateSection(UpdateMethod):
    """Update of the drive from the errors of the playbacks so far."""

    iteration_gain: GainPerChannel = Field(
        description="Share of the error that a playback corrects, above 0 to 1: one number, or one for each response."
    )
    gain_curve: Annotated[tuple[GainPoint, ...], AS_TUPLE] = Field(
        default=(), description="Shares of the gain over frequency, straight lines between points."
    )
    watch: Annotated[tuple[str, ...], AS_TUPLE] = Field(
        default=(),
        description="Monitored responses: reported, but neither controlled nor judged; their target may be zero "
        "or missing.",
    )
    weights: dict[str, Positive] = Field(
        default_factory=dict,
        description="How much a response counts beside the others where there are more than drives; left out: 1.",
    )
    groups: dict[str, ResponseGroup] = Field(
        default_factory=dict, description="Responses that share a gain, a weight or both, under a name that you choose."
    )
    accept_segments: bool | None = Field(
        default=None,
        description="Start each drive from the best so far, stretch by stretch, and step less where it got worse; left "
        "out: true for secant only.",
    )

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        _require_rising([point.frequency for point in self.gain_curve], field="gain_curve")
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

    @property
    def accepts_segments(self) -> bool:
        """Whether each drive starts from the best one so far, segment by segment."""
        if self.accept_segments is None:
            return self.kind is UpdateKind.SECANT and self.plugin is None
        return self.accept_segments

    def resolved(self, responses: Sequence[str], *, drives: int) -> ResolvedUpdate:
        """Return the update with one value for each response of a rig.

        Parameters
        ----------
        responses : sequence of str
            Names of the rig's responses, in its order.
        drives : int
            Number of drives of the rig.

        Returns
        -------
        ResolvedUpdate
            Update as sent to the iterator.

        Raises
        ------
        SettingsError
            If a channel is unknown, a response has no gain, or fewer responses are controlled than there are drives.
        """
        curve: dict[str, object] = {}
        if self.gain_curve:
            curve["gain_curve_frequency"] = tuple(point.frequency for point in self.gain_curve)
            curve["gain_curve_share"] = tuple(
                per_channel(point.share, responses, key="update.gain_curve") for point in self.gain_curve
            )
        method = {key: getattr(self, key) for key in UpdateMethod.model_fields}
        return ResolvedUpdate.model_validate(
            {
                **method,
                **curve,
                "iteration_gain": self._gains(responses),
                "weights": self._weights(responses, drives=drives),
                "accept_segments": self.accepts_segments,
            }
        )

    def _gains(self, responses: Sequence[str]) -> tuple[float, ...]:
        """Return the gain of each response, from its group if that has one."""
        in_groups = [name for group in self.groups.values() for name in group.channels]
        _require_responses(in_groups, responses=responses, key="update.groups")
        gains = {
            name: group.iteration_gain
            for group in self.groups.values()
            if group.iteration_gain is not None
            for name in group.channels
        }
        others = [name for name in responses if name not in gains]
        gains |= zip(others, per_channel(self.iteration_gain, others, key="update.iteration_gain"), strict=True)
        return tuple(gains[name] for name in responses)

    def _weights(self, responses: Sequence[str], *, drives: int) -> tuple[float, ...] | None:
        """Return the weight of each response, 0 for a monitored one; None if all have the same weight."""
        _require_responses(self.watch, responses=responses, key="update.watch")
        _require_responses(list(self.weights), responses=responses, key="update.weights")
        given = {name: group.weight for group in self.groups.values() for name in group.channels if group.weight}
        given |= self.weights | dict.fromkeys(self.watch, 0.0)
        if not given:
            return None
        controlled = len(responses) - len(self.watch)
        if controlled < drives:
            raise SettingsError(
                f"update.watch leaves {controlled} of {len(responses)} responses to control; the rig has {drives} "
                "drives and needs as many at least.",
                field="update.watch",
            )
        return tuple(float(given.get(name, 1.0)) for name in responses)


class StopCriteria(Section):
    """Stop criteria of the iteration: the message `duralab.v1.StopCriteria`."""

    iterations: int = Field(ge=1, le=1000, description="Largest number of playbacks of the target.")
    relative_rms_error: NotNegative = Field(
        default=0.0, description="End when every channel's relative RMS error is at most this; 0: off."
    )
    divergence_ratio: NotNegative = Field(
        default=0.0, description="End when a channel's error exceeds this multiple of its best, above 1; 0: never."
    )
    damage_ratio: Ratios | None = Field(
        default=None,
        description="End only when every channel's damage, response over target, lies between, e.g. [0.8, 1.25].",
    )
    damage_exponent: Annotated[DamageExponent, Wire(zero=DamageExponent.FIVE)] = Field(
        default=DamageExponent.FIVE, strict=False, description="Slope of the S-N line: 3, 5 or 8."
    )
    damage_budget: NotNegative = Field(
        default=0.0,
        description="End before the specimen took this multiple of the target's damage, identification included; "
        "0: no limit.",
    )
    error_bound: Annotated[Bound | None, Wire(zero=3.0, none=inf)] = Field(
        default=3.0,
        description="End the campaign where a playback's relative RMS error of a channel passes this, measured or "
        "predicted by the model; a rig at rest has 1; null: no bound.",
    )
    peak_bound: Annotated[Bound | None, Wire(zero=3.0, none=inf)] = Field(
        default=3.0, description="Bound on a channel's peak over the target's; null: no bound."
    )
    damage_bound: Annotated[Bound | None, Wire(zero=250.0, none=inf)] = Field(
        default=250.0,
        description="Bound on a channel's damage in one playback over the target's, at damage_exponent; null: "
        "no bound.",
    )
    smallest_improvement: float = Field(
        default=0.0, ge=0, lt=1, description="End when the last playbacks did not lower the best error by this share."
    )
    improvement_playbacks: Annotated[int, Field(ge=1, le=1000), Wire(zero=2)] = Field(
        default=2, description="Number of playbacks for stop.smallest_improvement."
    )

    @model_validator(mode="after")
    def _check_ratios(self) -> Self:
        _require_around_one(self, "damage_ratio")
        if 0.0 < self.divergence_ratio <= 1.0:
            raise MisfitError(
                f"has divergence_ratio {self.divergence_ratio:g}; it must be above 1, or 0 to never end so",
                field="divergence_ratio",
            )
        return self


class PlaybackSettings(Section):
    """Settings of the playbacks of a campaign: fields of the message `duralab.v1.CampaignSpec`."""

    limit_policy: Annotated[LimitPolicy, Wire(zero=LimitPolicy.REFUSE)] = Field(
        default=LimitPolicy.PROJECT,
        strict=False,
        description="Handling of a drive past a limit: project plays a near one and reports it, refuse ends the "
        "campaign.",
    )
    largest_overrun: Annotated[float, Field(ge=1, le=1000), Wire(zero=1.25)] = Field(
        default=1.25,
        description="Multiple of a limit that the first drive may ask for to be projected; a target that asks for more "
        "is refused before it is played.",
    )
    levels: Gains = Field(
        default=(),
        description="Share of the target in each of the first playbacks, rising to 1, e.g. [0.5, 0.75, 1.0]; left out: "
        "all play the whole target.",
    )
    confirmations: int = Field(
        default=0,
        ge=0,
        le=100,
        description="Number of extra playbacks of the best drive, each with other seeds; the result then shows how "
        "far the rig repeats itself.",
    )
    real_time: bool = Field(
        default=False,
        description="Play in real time, as a rehearsal of a real rig; left out: as fast as possible.",
    )

    pre_test: Annotated[float | None, Field(gt=0, le=8760), Wire()] = Field(
        default=None,
        description="Largest age of a passed pre-test of the rig, in hours; left out: no pre-test is needed.",
    )

    @model_validator(mode="after")
    def _check_levels(self) -> Self:
        if self.levels and (list(self.levels) != sorted(self.levels) or self.levels[-1] != 1.0):
            raise MisfitError(
                f"levels is {list(self.levels)}; it must never fall and end with 1, the whole target", field="levels"
            )
        return self

    def require_whole_playback(self, stop: StopCriteria) -> None:
        """Check that a playback of the whole target follows those at partial level.

        Parameters
        ----------
        stop : StopCriteria
            Criteria with the number of playbacks.

        Raises
        ------
        MisfitError
            If none follows.
        """
        partial = sum(level < 1.0 for level in self.levels)
        if partial >= stop.iterations:
            raise MisfitError(
                f"levels has {partial} playbacks below 1 and stop.iterations is {stop.iterations}; at least one "
                "playback of the whole target must follow",
                field="levels",
            )


class ControlBandSettings(Section):
    """Band in which the target is reproduced and judged; its gain is 1 between the two edges."""

    lowest_frequency: NotNegative = Field(
        description="Lower edge in hertz; the target holds one period of it at least. 0: means and slow parts are "
        "reproduced, too, from the rig's static response on; it needs excitation.static_hold."
    )
    highest_frequency: Positive = Field(description="Upper edge in hertz.")
    lower_flank: Positive | None = Field(
        default=None,
        description="Width in hertz of the flank below the band, in which target and drives fade out, within the "
        "excited band; left out: half of lowest_frequency, or less where the excited band begins sooner.",
    )
    upper_flank: Positive | None = Field(
        default=None,
        description="Width in hertz of the flank above the band; left out: a tenth of highest_frequency, or less where "
        "the excited band ends sooner.",
    )

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.lowest_frequency >= self.highest_frequency:
            raise ValueError(
                f"reaches from {self.lowest_frequency:g} to {self.highest_frequency:g} Hz; "
                "lowest_frequency must be below highest_frequency"
            )
        if self.lower_flank is not None and self.lower_flank > self.lowest_frequency:
            raise ValueError(f"has lower_flank {self.lower_flank:g} Hz; it must not exceed lowest_frequency")
        return self


class Acceptance(Section):
    """Limits by which report, exit code, comparison and sweep judge the best playback; a null limit is not judged.

    The message `duralab.v1.Acceptance`.
    """

    relative_rms_error: Positive | None = Field(
        default=0.15, description="Largest relative RMS error of any controlled channel that is accepted."
    )
    peak_ratio: Ratios | None = Field(
        default=(0.9, 1.1), description="Smallest and largest peak that is accepted, response over target."
    )
    damage_ratio: Ratios | None = Field(
        default=(0.8, 1.25), description="Smallest and largest pseudo-damage that is accepted, response over target."
    )
    damage_exponent: DamageExponent | None = Field(
        default=None,
        strict=False,
        description="Slope of the S-N line that damage is judged at: 3, 5 or 8; left out: that of stop.",
    )
    energy_outside_band: float | None = Field(
        default=0.1,
        ge=0,
        le=1,
        description="Largest share of a target's energy outside the control band that is accepted, 0 to 1.",
    )

    @model_validator(mode="after")
    def _check_ratios(self) -> Self:
        for key in ("peak_ratio", "damage_ratio"):
            _require_around_one(self, key)
        limits = (self.relative_rms_error, self.peak_ratio, self.damage_ratio, self.energy_outside_band)
        if all(limit is None for limit in limits):
            raise ValueError("has no limit, all are null; give one limit at least, so that the result can be judged")
        return self


def _require_around_one(section: Section, key: str) -> None:
    bounds = getattr(section, key)
    if bounds is not None and not bounds[0] < 1.0 < bounds[1]:
        raise MisfitError(f"has {key} {list(bounds)}; the first must be below 1, the second above", field=key)


def _require_rising(frequencies: Sequence[float], *, field: str) -> None:
    if any(after <= before for before, after in pairwise(frequencies)):
        raise MisfitError(
            f"has a gain_curve at {list(frequencies)} Hz; the frequencies must rise from point to point", field=field
        )


def _require_responses(names: Sequence[str], *, responses: Sequence[str], key: str) -> None:
    unknown = [name for name in names if name not in responses]
    if unknown:
        raise SettingsError(
            f"{key} has unknown channel {', '.join(unknown)}; the responses are {', '.join(responses)}.", field=key
        )
