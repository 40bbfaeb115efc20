"""The three rigs of the identification studies, how they are excited, and what their FRF is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from frf_error import relative_error, root_mean_square
from numpy.typing import NDArray
from rig_cell import RigCell

from duralab_settings import EstimatorKind, ExcitationKind, PowerSpectrum, WhitePinkSpectrum
from identifier import white
from rig_sim import PlayableRig, load_any_rig, shipped_specimens

#: The band of a durability test; displacement falls above the corner as it does on a road.
LOWEST, HIGHEST = 0.5, 45.0
DISPLACEMENT = WhitePinkSpectrum(
    lowest_frequency=LOWEST, highest_frequency=HIGHEST, corner_frequency=2.0, decibels_per_octave=3
)
FORCE = white(LOWEST, HIGHEST)
#: Of a ground vibration test: from above the modes of the cords, 2.5 Hz, to beyond the last elastic one, 66.8 Hz.
SHAKER = white(3.0, 80.0)
#: Lines every 0.49 Hz; the resonance that lasts longest, 14.4 Hz at 8 %, falls below a millionth within one such block.
AXLE_BLOCK = 2048
#: 8 s, lines every 0.125 Hz: as wide as the narrowest resonance, 0.2 % at 31.5 Hz.
AEROSPACE_BLOCK = 4096
#: Of a block: no jump where one experiment follows another, and most of a burst still at its level.
FADE_SHARE = 0.125
#: Apart from those of the experiments that are judged, which count from 1.
REFERENCE_SEEDS = (1001, 1002)


def front_axle_compliant(block_samples: int = AXLE_BLOCK) -> RigCell:
    """Load the rig whose lateral and longitudinal actuators give way under load, at the levels of its campaigns."""
    return _load(
        "front_axle_compliant", [DISPLACEMENT] * 6, levels=[0.004, 0.003, 0.001] * 2, block_samples=block_samples
    )


def spindle_coupled(block_samples: int = AXLE_BLOCK) -> RigCell:
    """Load the paper's rig: vertical displacements of 4 mm, lateral forces of 600 N and longitudinal ones of 400 N."""
    spectra = [DISPLACEMENT, FORCE, FORCE] * 2
    return _load("spindle_coupled", spectra, levels=[0.004, 600.0, 400.0] * 2, block_samples=block_samples)


def aerospace(block_samples: int = AEROSPACE_BLOCK) -> RigCell:
    """Load the lightly damped structure, each shaker with 1 N."""
    return _load("aerospace", [SHAKER] * 4, levels=[1.0] * 4, block_samples=block_samples)


def _load(name: str, spectra: Sequence[PowerSpectrum], *, levels: Sequence[float], block_samples: int) -> RigCell:
    rig = _shipped(name)
    fade_seconds = FADE_SHARE * block_samples / rig.specimen.sample_rate
    return RigCell(rig, tuple(spectra), tuple(levels), block_samples, fade_seconds)


@cache
def _shipped(name: str) -> PlayableRig:
    return load_any_rig(shipped_specimens()[name])


@dataclass(frozen=True)
class Reference:
    """The best linear approximation of a rig at the level of a study, from long experiments.

    Parameters
    ----------
    frf
        Complex, shape (lines, responses, drives), at every line of the block; 0 outside the band.
    doubt
        Half of what its two experiments differ by, relative, over all lines of the band: how well it is known.
    """

    frf: NDArray[np.complex128]
    doubt: float


def long_reference(cell: RigCell, seconds: float) -> Reference:
    """Average two long experiments of different kinds, so that neither kind is its own judge.

    For Gaussian drives of one PSD the best linear approximation is one and the same, and a random orthogonal multisine
    of many lines tends to it (Pintelon & Schoukens, *System Identification*, chapter 3).
    """
    found = []
    for kind, estimator, seed in zip(
        (ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.PURE_RANDOM),
        (EstimatorKind.H1, EstimatorKind.LOCAL_RATIONAL),
        REFERENCE_SEEDS,
        strict=True,
    ):
        found.append(cell.play(cell.settings(kind, seconds=seconds, seed=seed)).estimate(estimator))
    frf, band = (found[0].frf + found[1].frf) / 2.0, found[0].valid
    difference = relative_error(found[0].frf[band], frf[band], levels=cell.levels)
    return Reference(frf, root_mean_square(difference))
