"""Experiment that identifies a rig: as a user writes it, and with a value for each drive of one rig."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, StrEnum
from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from duralab_settings.section import Section
from duralab_settings.values import (
    AS_TUPLE,
    Count,
    Level,
    MisfitError,
    NotNegative,
    Positive,
    PositivePerChannel,
    SettingsError,
    Wire,
    per_channel,
)
from duralab_settings.wording import explained

Levels = Annotated[tuple[Level, ...], AS_TUPLE, Field(min_length=1)]
Point = Annotated[tuple[Positive, Positive], AS_TUPLE]


class ExcitationKind(StrEnum):
    """Excitation of the identification."""

    PURE_RANDOM = "pure_random"
    """Gaussian noise, independent for every drive, averaged over overlapping Hann blocks."""
    BURST_RANDOM = "burst_random"
    """Noise that begins and stops within each block."""
    SWEPT_SINE = "swept_sine"
    """One sweep for each block, with the signs of a Hadamard matrix."""
    PSEUDO_RANDOM = "pseudo_random"
    """Multisines with independent phases for every drive."""
    HADAMARD = "hadamard"
    """One multisine for all drives, with the signs of a Hadamard matrix."""
    ORTHOGONAL_DFT = "orthogonal_dft"
    """One multisine for all drives, with the phases of a DFT matrix."""
    RANDOM_ORTHOGONAL = "random_orthogonal"
    """As orthogonal_dft, with random phases of every drive and of every experiment."""

    @property
    def is_multisine(self) -> bool:
        """Whether it is periodic in the block, on lines whose amplitudes are fixed."""
        return self in _MULTISINES


_MULTISINES = frozenset(
    {
        ExcitationKind.PSEUDO_RANDOM,
        ExcitationKind.HADAMARD,
        ExcitationKind.ORTHOGONAL_DFT,
        ExcitationKind.RANDOM_ORTHOGONAL,
    }
)


class LevelKind(Enum):
    """Kind of the drives' levels."""

    RMS = "rms"
    """RMS over the samples that the estimator uses."""
    PEAK = "peak"
    """Largest magnitude of the whole drive."""


class WhitePinkSpectrum(Section):
    """PSD that is flat from the band's lower edge to a corner, then falls to the band's upper edge; zero outside."""

    lowest_frequency: Positive = Field(description="Lower edge of the excited band, in hertz.")
    highest_frequency: Positive = Field(description="Upper edge of the excited band, in hertz.")
    corner_frequency: Positive = Field(description="End of the flat part of the spectrum, in hertz.")
    decibels_per_octave: NotNegative = Field(description="Fall of the spectrum above the corner; 0 is white.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        _require_band(self.lowest_frequency, self.highest_frequency)
        if not self.lowest_frequency <= self.corner_frequency <= self.highest_frequency:
            raise MisfitError(
                f"has its corner at {self.corner_frequency:g} Hz; it must lie in the band from "
                f"{self.lowest_frequency:g} to {self.highest_frequency:g} Hz",
                field="corner_frequency",
            )
        return self


class TabulatedSpectrum(Section):
    """PSD at given frequencies, straight between them on logarithmic axes; zero outside the table."""

    frequency: Annotated[tuple[Positive, ...], AS_TUPLE] = Field(
        min_length=2,
        description="Frequencies in hertz, rising, each greater than 0; the first and the last are the edges of "
        "the band.",
    )
    density: Annotated[tuple[Positive, ...], AS_TUPLE] = Field(
        min_length=2, description="Density at each frequency, in any unit, greater than 0; only their ratios count."
    )

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        if len(self.frequency) != len(self.density):
            raise MisfitError(
                f"has {len(self.frequency)} frequencies and {len(self.density)} densities; give one density for each "
                "frequency",
                field="density",
            )
        for before, after in pairwise(self.frequency):
            if not before < after:
                raise MisfitError(
                    f"goes from {before:g} to {after:g} Hz; its frequencies must rise, so sort them and leave out "
                    "doubles",
                    field="frequency",
                )
        return self

    @property
    def lowest_frequency(self) -> float:
        """Lower edge of the band, in hertz."""
        return self.frequency[0]

    @property
    def highest_frequency(self) -> float:
        """Upper edge of the band, in hertz."""
        return self.frequency[-1]


PowerSpectrum = WhitePinkSpectrum | TabulatedSpectrum
"""Shape of a PSD in a band; its size follows from the drive's level."""


class Spectrum(Section):
    """Shape of the PSD of one drive: white_pink or table."""

    white_pink: WhitePinkSpectrum | None = Field(default=None, description="Flat, then falling.")
    table: TabulatedSpectrum | None = Field(default=None, description="Points on logarithmic axes.")

    @model_validator(mode="before")
    @classmethod
    def _take_a_shape(cls, given: Any) -> Any:
        if isinstance(given, WhitePinkSpectrum):
            return {"white_pink": given}
        return {"table": given} if isinstance(given, TabulatedSpectrum) else given

    @model_validator(mode="after")
    def _check_one_shape(self) -> Self:
        if (self.white_pink is None) == (self.table is None):
            raise ValueError("needs either white_pink or a table, and not both")
        return self

    @property
    def shape(self) -> PowerSpectrum:
        """Given shape."""
        if self.table is not None:
            return self.table
        if self.white_pink is not None:
            return self.white_pink
        raise AssertionError("One of the two is given: it is checked when the spectrum is made.")


class ExcitationMethod(Section):
    """Excitation, independent of the rig."""

    kind: ExcitationKind = Field(
        default=ExcitationKind.RANDOM_ORTHOGONAL,
        strict=False,
        description="Kind of excitation; random_orthogonal separates noise, distortion and FRF.",
    )
    duration: Positive = Field(
        le=36000,
        description="Length of the experiment, in seconds; multisines use as many realisations as fit into it.",
    )
    fade: NotNegative = Field(description="Linear fade at its start and end, in seconds.")
    delay_blocks: Annotated[Count, Wire(zero=1)] = Field(
        default=1, description="Multisines: delay blocks before each capture, in which the transient decays."
    )
    # 2 is the default of a file; a message without the field means 1.
    capture_blocks: Annotated[Count, Wire(zero=1)] = Field(
        default=2,
        description="Multisines: blocks of each capture; with 2 or more, noise and distortion are distinguished.",
    )
    repeats: Annotated[Count, Wire(zero=1)] = Field(
        default=1, description="Multisines: number of times that each realisation is played."
    )
    realisations: Count | None = Field(
        default=None,
        description="Multisines: number of realisations with independent phases; left out: as many as fit.",
    )
    odd_lines: bool = Field(default=False, description="Multisines: excite odd lines only.")
    detection_share: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="Multisines: share of the lines that are not excited, to measure distortion there.",
    )
    minimise_crest_factor: bool = Field(default=False, description="Multisines: choose phases with small peaks.")
    burst_share: Annotated[float, Field(gt=0, le=1), Wire(zero=0.5)] = Field(
        default=0.5, description="Bursts and sweeps: share of a block with motion."
    )
    static_hold: float = Field(
        default=0.0,
        ge=0,
        le=600,
        description="Seconds for which each drive alone is held up, then down, after the rest of the experiment, to "
        "measure the static gain; control_band.lowest_frequency 0 needs it; 0: not measured.",
    )

    @model_validator(mode="after")
    def _check_fade(self) -> Self:
        if 2 * self.fade >= self.duration:
            raise MisfitError(
                f"has fades of {self.fade:g} s in {self.duration:g} s; nothing would be left, so shorten them",
                field="fade",
            )
        return self

    @model_validator(mode="after")
    def _check_multisine(self) -> Self:
        for name in ("odd_lines", "detection_share", "minimise_crest_factor"):
            if getattr(self, name) and not self.kind.is_multisine:
                raise MisfitError(
                    f"has {name} set for {self.kind.value}; only a multisine kind has lines and phases to choose, so "
                    "take one or leave it out",
                    field=name,
                )
        return self


class ResolvedExcitation(ExcitationMethod):
    """Excitation with one value for each drive of a rig, in its order: the message `duralab.v1.Excitation`."""

    spectrum: WhitePinkSpectrum | None = Field(
        default=None, description="PSD of every drive; left out where drive_spectra is given."
    )
    drive_spectra: tuple[Spectrum, ...] = Field(default=(), description="PSD of each drive, if they differ.")
    rms: Levels | None = Field(
        default=None, description="RMS of each drive, in its unit; left out where peak is given."
    )
    peak: Levels | None = Field(
        default=None, description="Largest magnitude of each drive, in its unit; given instead of rms."
    )
    seed: int = Field(default=0, ge=0, lt=2**64, description="Seed of all random numbers.")

    @model_validator(mode="after")
    def _check_drives(self) -> Self:
        if (self.rms is None) == (self.peak is None):
            raise MisfitError(
                "needs an rms or a peak for its drives, and not both", field="rms" if self.rms is None else "peak"
            )
        if (self.spectrum is None) == (not self.drive_spectra):
            raise MisfitError("needs one spectrum for all drives or drive_spectra, and not both", field="drive_spectra")
        if self.drive_spectra and len(self.drive_spectra) != len(self.levels):
            raise MisfitError(
                f"has {len(self.drive_spectra)} spectra and {len(self.levels)} levels; give one of each for "
                "every drive",
                field="drive_spectra",
            )
        first = self.spectra[0]
        for index, spectrum in enumerate(self.spectra):
            if (spectrum.lowest_frequency, spectrum.highest_frequency) != (
                first.lowest_frequency,
                first.highest_frequency,
            ):
                raise MisfitError(
                    f"has a PSD of drive {index} that spans {spectrum.lowest_frequency:g} to "
                    f"{spectrum.highest_frequency:g} Hz, that of drive 0 {first.lowest_frequency:g} to "
                    f"{first.highest_frequency:g} Hz; a line is identified only where every drive is excited, so give "
                    "all the same band, with a low density where need be",
                    field="drive_spectra",
                )
        return self

    @property
    def level_kind(self) -> LevelKind:
        """Kind of the levels."""
        return LevelKind.RMS if self.peak is None else LevelKind.PEAK

    @property
    def levels(self) -> tuple[float, ...]:
        """Level of each drive, in its unit."""
        return self.rms or self.peak or ()

    @property
    def spectra(self) -> tuple[PowerSpectrum, ...]:
        """Shape of the PSD of each drive; drives of one group share one."""
        if self.spectrum is not None:
            return (self.spectrum,) * len(self.levels)
        return tuple(spectrum.shape for spectrum in self.drive_spectra)


class DriveSpectrum(Section):
    """Shape of one drive's spectrum, if it differs from that of the others."""

    corner_frequency: Positive | None = Field(default=None, description="End of the flat part, in hertz.")
    decibels_per_octave: NotNegative = Field(default=0.0, description="Fall of the spectrum above the corner.")
    table: Annotated[tuple[Point, ...], AS_TUPLE] | None = Field(
        default=None,
        description="Instead of the above: [frequency in hertz, density] in rising order, straight on logarithmic "
        "axes between them; from lowest_frequency to highest_frequency.",
    )

    @model_validator(mode="after")
    def _check_one_shape(self) -> Self:
        if (self.corner_frequency is None) == (self.table is None):
            raise ValueError("needs either a corner_frequency or a table, and not both")
        return self


class AtTarget(Section):
    """Second experiment of an identification: by the model of the first its responses have the target's spectra."""

    level: float = Field(
        default=0.5, gt=0, le=1, description="RMS of the controlled responses over that of the target."
    )
    duration: Positive = Field(le=36000, description="Length of the second experiment, in seconds.")


class ExcitationSettings(ExcitationMethod):
    """Experiment that identifies the rig."""

    lowest_frequency: Positive = Field(description="Lower edge of the excited band, in hertz.")
    highest_frequency: Positive = Field(description="Upper edge of the excited band, in hertz.")
    corner_frequency: Positive = Field(description="End of the flat part of the spectrum, in hertz.")
    decibels_per_octave: NotNegative = Field(description="Fall of the spectrum above the corner; 0 is white.")
    drive_spectra: dict[str, DriveSpectrum] | None = Field(
        default=None, description="Spectra of single drives by name, where they differ."
    )
    rms: PositivePerChannel | None = Field(
        default=None, description="RMS of the drives in their unit: one number for all, or one for each drive by name."
    )
    peak: PositivePerChannel | None = Field(
        default=None, description="Instead of rms: largest magnitude of the drives."
    )
    at_target: AtTarget | None = Field(
        default=None,
        description="Second experiment at the level of the target, e.g. {level: 0.5, duration: 75}: the first one can "
        "then be quiet; left out: none.",
    )

    @model_validator(mode="after")
    def _check_second_experiment(self) -> Self:
        if self.at_target is not None and not self.kind.is_multisine:
            raise MisfitError(
                f"has at_target for {self.kind.value}; only a multisine can have the spectra of a target, so take "
                "random_orthogonal or leave it out",
                field="at_target",
            )
        if self.at_target is not None and 2 * self.fade >= self.at_target.duration:
            raise MisfitError(
                f"has fades of {self.fade:g} s in {self.at_target.duration:g} s of at_target; nothing would be left, "
                "so take a longer one",
                field="at_target.duration",
            )
        return self

    @model_validator(mode="after")
    def _check_band(self) -> Self:
        if not self.lowest_frequency < self.corner_frequency <= self.highest_frequency:
            raise MisfitError(
                f"has lowest_frequency {self.lowest_frequency:g}, corner_frequency {self.corner_frequency:g} and "
                f"highest_frequency {self.highest_frequency:g} Hz; they must rise in this order",
                field="corner_frequency",
            )
        if (self.rms is None) == (self.peak is None):
            raise MisfitError("needs an rms or a peak, and not both", field="rms")
        return self

    @property
    def levels(self) -> tuple[str, float | dict[str, float]]:
        """Kind of the levels ("rms" or "peak"), and their values."""
        if self.rms is not None:
            return "rms", self.rms
        if self.peak is not None:
            return "peak", self.peak
        raise AssertionError("One of the two is given: it is checked when the file is read.")

    def resolved(self, drives: Sequence[str], *, seed: int = 0) -> ResolvedExcitation:
        """Return the excitation with one value for each drive of a rig.

        Parameters
        ----------
        drives : sequence of str
            Names of the rig's drives, in its order.
        seed : int
            Seed of its random parts, 0 to 2^64 - 1.

        Returns
        -------
        ResolvedExcitation
            Excitation as sent to the identifier.

        Raises
        ------
        SettingsError
            If a level or a spectrum is that of an unknown drive, or a level is missing.
        """
        self.require_drives(drives)
        name, given = self.levels
        common = self._white_pink(self.corner_frequency, self.decibels_per_octave)
        shapes: dict[str, object] = {"spectrum": common}
        if self.drive_spectra:
            own = self.drive_spectra
            shapes = {"drive_spectra": tuple(self._spectrum(own.get(drive), common=common) for drive in drives)}
        method = {key: getattr(self, key) for key in ExcitationMethod.model_fields}
        levels = {name: per_channel(given, drives, key=f"excitation.{name}")}
        try:
            return ResolvedExcitation.model_validate({**method, **shapes, **levels, "seed": seed})
        except ValidationError as error:
            raise explained(error, ResolvedExcitation, prefix="excitation") from error

    def require_drives(self, drives: Sequence[str]) -> None:
        """Check the names of the drives with a separate spectrum.

        Parameters
        ----------
        drives : sequence of str
            Names of the rig's drives.

        Raises
        ------
        SettingsError
            If the rig has no drive of such a name.
        """
        unknown = [drive for drive in self.drive_spectra or {} if drive not in drives]
        if unknown:
            raise SettingsError(
                f"excitation.drive_spectra has unknown channel {', '.join(unknown)}; the drives are "
                f"{', '.join(drives)}.",
                field="excitation.drive_spectra",
            )

    def _spectrum(self, own: DriveSpectrum | None, *, common: dict[str, float]) -> dict[str, object]:
        if own is None:
            return {"white_pink": common}
        if own.table is not None:
            frequency, density = tuple(zip(*own.table, strict=True)) or ((), ())
            return {"table": {"frequency": frequency, "density": density}}
        corner = own.corner_frequency or self.corner_frequency
        return {"white_pink": self._white_pink(corner, own.decibels_per_octave)}

    def _white_pink(self, corner_frequency: float, decibels_per_octave: float) -> dict[str, float]:
        return {
            "lowest_frequency": self.lowest_frequency,
            "highest_frequency": self.highest_frequency,
            "corner_frequency": corner_frequency,
            "decibels_per_octave": decibels_per_octave,
        }


def _require_band(lowest: float, highest: float) -> None:
    if not lowest < highest:
        raise MisfitError(
            f"has a band from {lowest:g} to {highest:g} Hz; it must end above its beginning", field="highest_frequency"
        )
