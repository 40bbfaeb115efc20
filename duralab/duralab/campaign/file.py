"""The campaign file: what a user writes to say which loads to reproduce, on which rig, how, and for how long."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, PrivateAttr, model_validator

from duralab.campaign.identification import EstimatorSettings, ExcitationSettings
from duralab.campaign.iteration import AtLimits, DamageExponent, StopSection, UpdateSection
from duralab.campaign.target_edit import EditStep, SourceChannel
from duralab.campaign.values import Levels, NotNegative, Positive, Range, Section, Seed


class Potholes(Section):
    """Rounded holes at random places, each in one wheel track."""

    count: int = Field(ge=1, le=1000, description="How many.")
    depth: Range = Field(strict=False, description="Shallowest and deepest, in metres, e.g. [0.02, 0.05].")
    length: Range = Field(strict=False, description="Shortest and longest, in metres, e.g. [0.4, 1.0].")

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for key in ("depth", "length"):
            least, greatest = getattr(self, key)
            if least > greatest:
                raise ValueError(f"has {key} [{least:g}, {greatest:g}]; the first must not exceed the second")
        return self


class SyntheticRoad(Section):
    """A rough road made from a seed."""

    iso_class: str = Field(
        pattern="^[A-E](/[A-E])?$",
        description="Roughness class of ISO 8608: A (very good) to E (very poor), or C/D for the mean of two.",
    )
    seed: Seed = Field(description="Seed of the road's unevenness and of its potholes.")
    duration: Positive = Field(le=3600, description="How long the vehicle drives on it, in seconds.")
    potholes: Potholes | None = Field(default=None, description="Holes in the road; none where left out.")


class MeasuredRoad(Section):
    """A measured road surface in OpenCRG format, run through forward and backward until the time is up."""

    path: Path = Field(strict=False, description="The OpenCRG file (.crg), relative to the campaign file.")
    duration: Positive = Field(le=3600, description="How long the vehicle drives on it, in seconds.")


class Target(Section):
    """What to reproduce: the spindle forces of a vehicle on a road, or a measured file."""

    road: SyntheticRoad | None = Field(default=None, description="A road made from a seed.")
    opencrg: MeasuredRoad | None = Field(default=None, description="A measured road.")
    file: Path | None = Field(
        default=None,
        strict=False,
        description="Measured target, relative to the campaign file: RPC III, MDF4, UFF58, TDMS, MAT, Parquet or CSV.",
    )
    channels: dict[str, SourceChannel] = Field(
        default_factory=dict,
        description="Channel of the file, its unit and its sign for each response; left out: the one of its name.",
    )
    vehicle: str | None = Field(default=None, description="The rig that plays roads, whose responses are the target.")
    speed: Positive = Field(default=15.0, le=60, description="Speed of the vehicle, in metres per second.")
    edit: tuple[EditStep, ...] = Field(
        default=(), strict=False, description="What is done with it before it is reproduced, one step after the other."
    )

    @model_validator(mode="after")
    def _check_one_source(self) -> Self:
        sources = [name for name in ("road", "opencrg", "file") if getattr(self, name) is not None]
        if len(sources) != 1:
            found = " and ".join(sources) if sources else "none"
            raise ValueError(f"has {found} of road, opencrg and file; exactly one is needed")
        if self.file is None and self.vehicle is None:
            raise ValueError(f"has a {sources[0]} but no vehicle to drive on it; name one, e.g. 'vehicle: predecessor'")
        if self.file is not None and self.vehicle is not None:
            raise ValueError("has a file and a vehicle; a file is the target already, so leave the vehicle out")
        if self.file is None and self.channels:
            raise ValueError("has channels but no file; the responses of a vehicle have their names already")
        return self


class ControlBand(Section):
    """Where the target is reproduced and judged; it is whole between the two edges."""

    lowest_frequency: Positive = Field(description="Lower edge in hertz; the target holds one period of it at least.")
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
    """What report, exit code, comparison and sweep judge the best playback by; a limit that is null is not judged."""

    relative_rms_error: Positive | None = Field(
        default=0.15, description="Largest relative RMS error of any controlled channel that is accepted."
    )
    peak_ratio: tuple[NotNegative, Positive] | None = Field(
        default=(0.9, 1.1),
        strict=False,
        description="Smallest and largest peak that is accepted, response over target.",
    )
    damage_ratio: tuple[NotNegative, Positive] | None = Field(
        default=(0.8, 1.25),
        strict=False,
        description="Smallest and largest pseudo-damage that is accepted, response over target.",
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
            bounds = getattr(self, key)
            if bounds is not None and not bounds[0] < 1.0 < bounds[1]:
                raise ValueError(f"has {key} {list(bounds)}; the first must be below 1, the second above")
        limits = (self.relative_rms_error, self.peak_ratio, self.damage_ratio, self.energy_outside_band)
        if all(limit is None for limit in limits):
            raise ValueError("has no limit, all are null; give one limit at least, so that the result can be judged")
        return self


class Confirm(Section):
    """Whether the best drive is played again after the iteration."""

    playbacks: int = Field(
        default=0,
        ge=0,
        le=100,
        description="How often, each time with other seeds; the result then tells how far the rig repeats itself.",
    )


class Campaign(Section):
    """A whole campaign: the content of a campaign file."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,59}$",
        description="Lower case letters, digits, '-' and '_'; names the campaign and its recording.",
    )
    rig: str = Field(pattern=r"^[a-z0-9][a-z0-9_]{0,59}$", description="The rig that reproduces the target.")
    seed: Seed = Field(description="Every random number of the campaign comes from this seed.")
    target: Target = Field(description="What to reproduce.")
    excitation: ExcitationSettings = Field(description="The experiment that identifies the rig.")
    estimator: EstimatorSettings = Field(description="How the model is estimated from the experiment.")
    control_band: ControlBand = Field(description="Where the target is reproduced and judged.")
    update: UpdateSection = Field(description="How each next drive is made.")
    stop: StopSection = Field(description="When the iteration ends.")
    confirm: Confirm = Field(default=Confirm(), description="Playing the best drive again, to know how far it repeats.")
    at_limits: AtLimits = Field(
        default=AtLimits.PROJECT,
        strict=False,
        description="What becomes of a drive past a limit: project plays a near one and says so, refuse ends the "
        "campaign.",
    )
    largest_overrun: float = Field(
        default=1.25,
        ge=1,
        le=1000,
        description="Multiple of a limit that the first drive may ask for to be projected; a target that asks for more "
        "is refused before it is played.",
    )
    levels: Levels = Field(
        default=(),
        strict=False,
        description="Share of the target in each of the first playbacks, rising to 1, e.g. [0.5, 0.75, 1.0]; left out: "
        "all play the whole target.",
    )
    real_time: bool = Field(
        default=False,
        description="Whether the rig plays in real time, as a rehearsal of a real one; left out: as fast as it can.",
    )
    accept: Acceptance = Field(
        default=Acceptance(), description="What the result is judged by; left out: the defaults of its keys."
    )

    _folder: Path = PrivateAttr(default=Path())
    _text: str = PrivateAttr(default="")

    @model_validator(mode="after")
    def _check_control_band(self) -> Self:
        band, excited = self.control_band, self.excitation
        lowest = band.lowest_frequency - (band.lower_flank or 0.0)
        highest = band.highest_frequency + (band.upper_flank or 0.0)
        if lowest < excited.lowest_frequency or highest > excited.highest_frequency:
            flanks = "" if band.lower_flank is None and band.upper_flank is None else " with its flanks"
            raise ValueError(
                f"control_band reaches{flanks} from {lowest:g} to {highest:g} Hz; it must lie in "
                f"the excited band from {excited.lowest_frequency:g} to {excited.highest_frequency:g} Hz"
            )
        return self

    @model_validator(mode="after")
    def _check_levels(self) -> Self:
        if not self.levels:
            return self
        if list(self.levels) != sorted(self.levels) or self.levels[-1] != 1.0:
            raise ValueError(f"levels is {list(self.levels)}; it must never fall and end with 1, the whole target")
        partial = sum(level < 1.0 for level in self.levels)
        if partial >= self.stop.iterations:
            raise ValueError(
                f"levels has {partial} playbacks below 1 and stop.iterations is {self.stop.iterations}; at least one "
                "playback of the whole target must follow"
            )
        return self

    @property
    def rigs(self) -> tuple[str, ...]:
        """The rigs it needs: its own and, where a road is driven, the vehicle's."""
        return tuple(dict.fromkeys(name for name in (self.rig, self.target.vehicle) if name is not None))

    @property
    def folder(self) -> Path:
        """Where the relative paths of the file start."""
        return self._folder

    @property
    def text(self) -> str:
        """The file, word for word; for a campaign that was made in a script, what would be written in one."""
        if self._text:
            return self._text
        import yaml

        content = self.model_dump(mode="json", exclude_none=True)
        # A limit that is null is not judged; one that is left out has its default.
        content["accept"] = self.accept.model_dump(mode="json")
        return yaml.safe_dump(content, sort_keys=False)

    def read_from(self, *, folder: Path, text: str) -> Self:
        """Return this campaign with the place and the words it was read from."""
        copy = self.model_copy()
        copy._folder = folder  # noqa: SLF001  (its own private attribute, on its own copy)
        copy._text = text  # noqa: SLF001
        return copy
