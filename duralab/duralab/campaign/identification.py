"""The part of a campaign file that says how the rig is identified: the experiment and the estimator."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from duralab.campaign.values import NotNegative, Positive, PositivePerChannel, Section

Count = Annotated[int, Field(ge=1, le=10_000)]
# YAML knows lists only.
Point = Annotated[tuple[Positive, Positive], Field(strict=False)]


class ExcitationKind(StrEnum):
    """How the rig is excited to identify it."""

    PURE_RANDOM = "pure_random"
    BURST_RANDOM = "burst_random"
    SWEPT_SINE = "swept_sine"
    PSEUDO_RANDOM = "pseudo_random"
    HADAMARD = "hadamard"
    ORTHOGONAL_DFT = "orthogonal_dft"
    RANDOM_ORTHOGONAL = "random_orthogonal"


class DriveSpectrum(Section):
    """The shape of one drive's spectrum, where it differs from that of the others."""

    corner_frequency: Positive | None = Field(default=None, description="End of the flat part, in hertz.")
    decibels_per_octave: NotNegative = Field(default=0.0, description="Fall of the spectrum above the corner.")
    table: list[Point] | None = Field(
        default=None,
        description="Instead of the above: [frequency in hertz, density] in rising order, straight on logarithmic "
        "axes between them; from lowest_frequency to highest_frequency.",
    )

    @model_validator(mode="after")
    def _check_one_shape(self) -> Self:
        if (self.corner_frequency is None) == (self.table is None):
            raise ValueError("needs either a corner_frequency or a table, and not both")
        return self


class ExcitationSettings(Section):
    """The experiment that identifies the rig."""

    kind: ExcitationKind = Field(
        default=ExcitationKind.RANDOM_ORTHOGONAL,
        strict=False,
        description="How the drives are made; random_orthogonal tells noise, distortion and FRF apart.",
    )
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
    duration: Positive = Field(
        le=36000, description="Length of the experiment, in seconds; of multisines as many realisations as fit into it."
    )
    fade: NotNegative = Field(description="Linear fade at its start and end, in seconds.")
    delay_blocks: Count = Field(default=1, description="Multisines: blocks that die out before each capture.")
    capture_blocks: Count = Field(
        default=2, description="Multisines: blocks used of each capture; from 2 on noise and distortion are told apart."
    )
    repeats: Count = Field(default=1, description="Multisines: how often each realisation is played.")
    realisations: Count | None = Field(default=None, description="Multisines: independent phases; as many as fit.")
    odd_lines: bool = Field(default=False, description="Multisines: excite odd lines only.")
    detection_share: float = Field(
        default=0.0, ge=0, le=0.5, description="Multisines: share of the lines left out to see distortion there."
    )
    minimise_crest_factor: bool = Field(default=False, description="Multisines: choose phases with small peaks.")
    burst_share: float = Field(default=0.5, gt=0, le=1, description="Bursts and sweeps: share of a block in motion.")

    @property
    def levels(self) -> tuple[str, float | dict[str, float]]:
        """How the levels are given ("rms" or "peak"), and what they are."""
        if self.rms is not None:
            return "rms", self.rms
        if self.peak is not None:
            return "peak", self.peak
        raise AssertionError("One of the two is given: it is checked when the file is read.")

    @model_validator(mode="after")
    def _check_band(self) -> Self:
        if not self.lowest_frequency < self.corner_frequency <= self.highest_frequency:
            raise ValueError(
                f"has lowest_frequency {self.lowest_frequency:g}, corner_frequency {self.corner_frequency:g} and "
                f"highest_frequency {self.highest_frequency:g} Hz; they must rise in this order"
            )
        if 2 * self.fade >= self.duration:
            raise ValueError(f"has fades of {self.fade:g} s in {self.duration:g} s; nothing would be left")
        if (self.rms is None) == (self.peak is None):
            raise ValueError("needs an rms or a peak, and not both")
        return self


class EstimatorKind(StrEnum):
    """How the frequency response is estimated."""

    H1 = "h1"
    H2 = "h2"
    HV = "hv"
    LOCAL_POLYNOMIAL = "local_polynomial"
    LOCAL_RATIONAL = "local_rational"


class EstimatorSettings(Section):
    """How the rig's frequency response is estimated from the experiment."""

    kind: EstimatorKind = Field(
        default=EstimatorKind.H1, strict=False, description="The estimator; local ones are free of leakage."
    )
    block_samples: int = Field(ge=256, le=2**20, multiple_of=2, description="Samples in a block, even.")
    overlap: float = Field(
        default=0.5, ge=0, lt=1, description="Overlap of neighbouring blocks, as a share of one; of pure random only."
    )
    local_order: int | None = Field(default=None, ge=1, le=6, description="Local methods: order of the polynomials.")
    local_half_width: int | None = Field(
        default=None, ge=1, le=1000, description="Local methods: lines on either side of each that are fitted."
    )
