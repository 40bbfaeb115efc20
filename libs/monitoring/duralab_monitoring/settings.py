"""Settings of monitoring: baseline of an event, allowed rate of false alarms, limits of each statistic."""

from __future__ import annotations

from enum import StrEnum
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from duralab_settings import DamageExponent, MisfitError, NotNegative, Positive, Section


class Statistic(StrEnum):
    """Statistics of a channel over one repeat, in the order of their columns."""

    MIN = "min"
    """Smallest sample, the channel's unit."""
    MAX = "max"
    """Largest sample, the channel's unit."""
    MEAN = "mean"
    """Mean, the channel's unit."""
    RMS = "rms"
    """Root mean square, the channel's unit."""
    STD = "std"
    """Standard deviation, the channel's unit."""
    DAMAGE = "damage"
    """Pseudo-damage, the channel's unit to the power of the damage exponent."""


class Levels(Section):
    """Two levels of an alarm, as shares of the baseline."""

    warning: NotNegative = Field(description="Share of the baseline from which on a change is a warning.")
    abort: Positive = Field(description="Share of the baseline from which on a change is an abort.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.abort < self.warning:
            raise MisfitError(
                f"has the warning at {self.warning:g} and the abort at {self.abort:g}; the warning comes first",
                field="abort",
            )
        return self


Interval = Annotated[tuple[float, float], Field(strict=False)]


class AbsoluteLimits(Section):
    """Allowed range of a statistic, at one or both levels."""

    warning: Interval | None = Field(default=None, description="[lowest, highest] without a warning.")
    abort: Interval | None = Field(default=None, description="[lowest, highest] without an abort.")

    @model_validator(mode="after")
    def _check_intervals(self) -> Self:
        if self.warning is None and self.abort is None:
            raise MisfitError("has neither warning nor abort; give [lowest, highest] of at least one", field="warning")
        for key, interval in (("warning", self.warning), ("abort", self.abort)):
            if interval is not None and not interval[0] < interval[1]:
                raise MisfitError(f"is {list(interval)}; give [lowest, highest], the lower one first", field=key)
        if self.warning and self.abort and not self.abort[0] <= self.warning[0] < self.warning[1] <= self.abort[1]:
            raise MisfitError(
                f"has the warning at {list(self.warning)} outside the abort at {list(self.abort)}; the warning comes "
                "first",
                field="warning",
            )
        return self


class MonitoringSettings(Section):
    """Monitoring of the repeats of an endurance test; the section `monitoring` of a schedule."""

    baseline_repeats: int = Field(
        default=10, ge=6, le=1000, description="First repeats of each event, from which its baseline is learnt."
    )
    false_alarms: float = Field(
        default=1.0,
        gt=0,
        le=1000,
        description="Most false alarms in 10,000 repeats, over all channels, bands and statistics together.",
    )
    bands: tuple[Positive, ...] = Field(
        default=(0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0),
        min_length=2,
        max_length=33,
        strict=False,
        description="Edges in Hz, rising, of the bands that changes are located in.",
    )
    change: Levels = Field(
        default=Levels(warning=0.0, abort=0.3),
        description="Levels of a detected change of the response in a band, as a share of the channel's RMS. With a "
        "warning level of 0 each change that noise does not explain is a warning.",
    )
    learnt_limits: Levels = Field(
        default=Levels(warning=0.1, abort=0.3),
        description="Levels of a statistic's deviation from its baseline: of min and max as a share of half the range, "
        "of mean, rms and std as a share of the RMS; of damage as the change of amplitude that explains it.",
    )
    limits: dict[str, dict[Annotated[Statistic, Field(strict=False)], AbsoluteLimits]] = Field(
        default={}, description="Absolute limits by channel and statistic, in the unit of the statistic."
    )
    damage_exponent: DamageExponent = Field(
        default=DamageExponent.FIVE, strict=False, description="Slope of the S-N line of the damage: 3, 5 or 8."
    )

    @model_validator(mode="after")
    def _check_bands(self) -> Self:
        if any(upper <= lower for lower, upper in pairwise(self.bands)):
            raise MisfitError(f"is {list(self.bands)}; the edges of bands rise", field="bands")
        return self
