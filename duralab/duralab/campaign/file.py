"""Campaign file: the loads to reproduce, the rig, the method and the stop criteria."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

from pydantic import Field, PrivateAttr, model_validator

from duralab.campaign.start_from import StartFrom
from duralab.campaign.target_edit import EditStep, SourceChannel
from duralab_gateway import CalculatedChannel
from duralab_settings import (
    Acceptance,
    ControlBandSettings,
    EstimatorSettings,
    ExcitationSettings,
    HoldSettings,
    MisfitError,
    PlaybackSettings,
    Positive,
    Range,
    Section,
    Seed,
    StopCriteria,
    UpdateSection,
    dump_yaml,
    with_new_keys,
)


class Potholes(Section):
    """Rounded holes at random places, each in one wheel track."""

    count: int = Field(ge=1, le=1000, description="Number of potholes.")
    depth: Range = Field(description="Smallest and largest depth, in metres, e.g. [0.02, 0.05].")
    length: Range = Field(description="Smallest and largest length, in metres, e.g. [0.4, 1.0].")

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for key in ("depth", "length"):
            least, greatest = getattr(self, key)
            if least > greatest:
                raise ValueError(f"has {key} [{least:g}, {greatest:g}]; the first must not exceed the second")
        return self


class SyntheticRoad(Section):
    """Rough road made from a seed."""

    iso_class: str = Field(
        pattern="^[A-E](/[A-E])?$",
        description="Roughness class of ISO 8608: A (very good) to E (very poor), or C/D for the mean of two.",
    )
    seed: Seed = Field(description="Seed of the road's unevenness and of its potholes.")
    duration: Positive = Field(le=3600, description="Duration of the drive over the road, in seconds.")
    potholes: Potholes | None = Field(default=None, description="Potholes of the road; no potholes if left out.")


class MeasuredRoad(Section):
    """Measured road surface in OpenCRG format, driven forward and backward until the duration is over."""

    path: Path = Field(strict=False, description="The OpenCRG file (.crg), relative to the campaign file.")
    duration: Positive = Field(le=3600, description="Duration of the drive over the road, in seconds.")


class Target(Section):
    """Target: the spindle forces of a vehicle on a road, or a measured file."""

    road: SyntheticRoad | None = Field(default=None, description="A road made from a seed.")
    opencrg: MeasuredRoad | None = Field(default=None, description="A measured road.")
    file: Path | None = Field(
        default=None,
        strict=False,
        description="Measured target, relative to the campaign file: RPC III, MDF4, UFF58, TDMS, MAT, Parquet or CSV.",
    )
    channels: dict[str, SourceChannel] = Field(
        default_factory=dict,
        description="Channel of the file, with unit and sign, for each response; left out: the channel with the "
        "same name.",
    )
    calculated: tuple[CalculatedChannel, ...] = Field(
        default=(),
        strict=False,
        description="Calculated channels: sum, difference or weighted sum of channels of the file; used like those.",
    )
    vehicle: str | None = Field(default=None, description="The rig that plays roads, whose responses are the target.")
    speed: Positive = Field(default=15.0, le=60, description="Speed of the vehicle, in metres per second.")
    edit: tuple[EditStep, ...] = Field(
        default=(), strict=False, description="Steps that edit the target before it is reproduced, in this order."
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
        if self.file is None and self.calculated:
            raise ValueError("has calculated channels but no file; let the rig calculate responses")
        if self.file is None and self.channels:
            raise ValueError("has channels but no file; the responses of a vehicle have their names already")
        return self


class Sections(Section):
    """Purpose of a campaign, and its sections."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,59}$",
        description="Name of the campaign and its recording: lower case letters, digits, '-' and '_'.",
    )
    rig: str = Field(pattern=r"^[a-z0-9][a-z0-9_]{0,59}$", description="Name of the rig that reproduces the target.")
    seed: Seed = Field(description="Seed of all random numbers of the campaign.")
    target: Target = Field(description="Signals to reproduce.")
    excitation: ExcitationSettings = Field(description="Experiment that identifies the rig.")
    estimator: EstimatorSettings = Field(description="Estimator of the model from the experiment.")
    control_band: ControlBandSettings = Field(description="Frequencies in which the target is reproduced and judged.")
    update: UpdateSection = Field(description="Update: the rule that makes each next drive.")
    stop: StopCriteria = Field(description="Criteria that end the iteration.")
    accept: Acceptance = Field(
        default=Acceptance(), description="Limits by which the result is judged; left out: the defaults of its keys."
    )
    hold: HoldSettings | None = Field(
        default=None,
        description="Before which playbacks a person decides: never, first, each, or bounds of the prediction, e.g. "
        "{predicted_peak: 1.2, predicted_damage: 2.0}; left out: never on a simulation, first on every other rig.",
    )
    start_from: StartFrom | None = Field(
        default=None, description="Model, drive and playbacks that the campaign starts from; left out: none."
    )


# The order of the bases gives the order of the keys: `Sections` first.
class Campaign(PlaybackSettings, Sections):
    """Campaign: the content of a campaign file."""

    _folder: Path = PrivateAttr(default=Path())
    _text: str = PrivateAttr(default="")
    _remarks: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="before")
    @classmethod
    def _take_old_keys(cls, content: Any) -> Any:
        return with_new_keys(content)[0] if isinstance(content, dict) else content

    @model_validator(mode="after")
    def _check_control_band(self) -> Self:
        band, excited = self.control_band, self.excitation
        lowest = band.lowest_frequency - (band.lower_flank or 0.0)
        highest = band.highest_frequency + (band.upper_flank or 0.0)
        static = band.lowest_frequency == 0.0
        if static and excited.static_hold == 0.0:
            raise MisfitError(
                "begins its control_band at 0 Hz and has excitation.static_hold 0, so that the static gain would not "
                "be measured; hold each drive as long as the rig needs to settle, e.g. 4 s",
                field="excitation.static_hold",
            )
        if (lowest < excited.lowest_frequency and not static) or highest > excited.highest_frequency:
            flanks = "" if band.lower_flank is None and band.upper_flank is None else " with its flanks"
            raise ValueError(
                f"control_band reaches{flanks} from {lowest:g} to {highest:g} Hz; it must lie in "
                f"the excited band from {excited.lowest_frequency:g} to {excited.highest_frequency:g} Hz"
            )
        return self

    @model_validator(mode="after")
    def _check_whole_playback(self) -> Self:
        self.require_whole_playback(self.stop)
        return self

    @property
    def rigs(self) -> tuple[str, ...]:
        """Rigs that the campaign needs: its own and, for a target driven over a road, the vehicle's."""
        return tuple(dict.fromkeys(name for name in (self.rig, self.target.vehicle) if name is not None))

    @property
    def folder(self) -> Path:
        """Folder to which the file's paths are relative."""
        return self._folder

    @property
    def text(self) -> str:
        """Exact text of the file; for a campaign made in a script, the text of an equivalent file."""
        if self._text:
            return self._text
        content = self.model_dump(mode="json", exclude_none=True)
        # Keep null limits: a null limit is not judged, whereas an omitted one has its default.
        content["accept"] = self.accept.model_dump(mode="json")
        return dump_yaml(content)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the file, one sentence each: keys that were renamed."""
        return self._remarks

    def read_from(self, *, folder: Path, text: str, remarks: tuple[str, ...] = ()) -> Self:
        """Return this campaign with the folder and the text of its file."""
        copy = self.model_copy()
        copy._folder = folder  # noqa: SLF001  (its own private attribute, on its own copy)
        copy._text = text  # noqa: SLF001
        copy._remarks = remarks  # noqa: SLF001
        return copy
