"""Estimator of a rig's frequency response: the message `duralab.v1.Estimator`."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from duralab_settings.section import Section


class EstimatorKind(StrEnum):
    """Estimator of the frequency response."""

    H1 = "h1"
    """H1: noise on the responses averages out."""
    H2 = "h2"
    """H2: noise on the drives averages out; only for equal numbers of responses and drives."""
    HV = "hv"
    """Total least squares of each response: noise on both."""
    LOCAL_POLYNOMIAL = "local_polynomial"
    """FRF and transient as polynomials over neighbouring lines: no leakage."""
    LOCAL_RATIONAL = "local_rational"
    """The same as local_polynomial with a common denominator, for sharp resonances."""

    @property
    def is_local(self) -> bool:
        """Whether it is a regression over neighbouring lines; the others average spectra."""
        return self in (EstimatorKind.LOCAL_POLYNOMIAL, EstimatorKind.LOCAL_RATIONAL)


class BlockSettings(Section):
    """Division of a record into blocks; an excitation is designed for them."""

    block_samples: int = Field(ge=256, le=2**20, multiple_of=2, description="Samples in a block, even.")
    overlap: float = Field(
        default=0.5,
        ge=0,
        lt=1,
        description="Overlap of neighbouring blocks, as a share of a block; for pure random excitation only.",
    )


class EstimatorSettings(BlockSettings):
    """Estimator of the rig's frequency response."""

    kind: EstimatorKind = Field(
        default=EstimatorKind.H1, strict=False, description="Estimator of the FRF; local ones are free of leakage."
    )
    local_order: int | None = Field(default=None, ge=1, le=6, description="Local methods: order of the polynomials.")
    local_half_width: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="Local methods: number of lines fitted on either side of each line; left out: chosen at each line.",
    )
