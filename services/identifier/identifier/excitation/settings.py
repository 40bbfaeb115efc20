"""What an excitation is told to be, checked by itself where it enters."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from identifier.excitation.power_spectrum import PowerSpectrum
from identifier.setting_error import SettingError
from spectra import hop_samples

SMALLEST_BLOCK_SAMPLES = 256
"""Fewer samples leave too few lines for an impulse response that dies out."""

LARGEST_DETECTION_SHARE = 0.5
"""Above this fewer lines would be excited than watched."""

LARGEST_LEVEL = 1e12
"""In whatever unit a drive has, far beyond any actuator: what is made of it, peaks and slopes, stays a number."""


class ExcitationKind(Enum):
    """How the drives of an experiment are made."""

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
    """The same with random phases of every drive and of every experiment."""

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
    """What the levels of the drives are."""

    RMS = "rms"
    """Root mean square over the samples that are used."""
    PEAK = "peak"
    """Largest magnitude of the whole drive."""


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings:
    """The excitation of one experiment.

    Parameters
    ----------
    spectra
        Shape of each drive's PSD, all of the same band; drives of one group share one.
    levels
        Of each drive, in its unit, greater than 0.
    duration_seconds
        Of random kinds and sweeps the whole length, of multisines at most that, fades included; greater than 0.
    block_samples
        Samples in a block, of multisines the period; even, 256 or more.
    fade_seconds
        Linear fade at the beginning and the end, and of multisines from one experiment to the next; of bursts and
        sweeps of each one; 0 or more, of multisines at most the delay.
    seed
        Of everything random, 0 to 2^64 - 1.
    kind
        How the drives are made.
    level_kind
        What the levels are.
    overlap
        Of the blocks of pure random, 0 up to but not including 1.
    delay_blocks
        Of multisines: periods played and dropped before each capture, 1 or more.
    capture_blocks
        Of multisines: periods used of each experiment, 1 or more; from 2 on noise and distortion can be told apart.
    repeats
        Of multisines: how often each realisation is played, 1 or more.
    realisations
        Of multisines: sets of new phases, 1 or more; None for as many as the duration holds.
    burst_share
        Of bursts and sweeps: share of a block that is not at rest, above 0 up to 1.
    odd_lines
        Of multisines: excite odd lines only.
    detection_share
        Of multisines: share of these lines left out at random, 0 for none, up to 0.5.
    minimise_crest_factor
        Of multisines: choose phases for a small ratio of peak to RMS.

    Raises
    ------
    SettingError
        Where a value is not allowed whatever the rig.
    """

    spectra: tuple[PowerSpectrum, ...]
    levels: tuple[float, ...]
    duration_seconds: float
    block_samples: int
    fade_seconds: float
    seed: int
    kind: ExcitationKind = ExcitationKind.RANDOM_ORTHOGONAL
    level_kind: LevelKind = LevelKind.RMS
    overlap: float = 0.5
    delay_blocks: int = 1
    capture_blocks: int = 2
    repeats: int = 1
    realisations: int | None = None
    burst_share: float = 0.5
    odd_lines: bool = False
    detection_share: float = 0.0
    minimise_crest_factor: bool = False

    def __post_init__(self) -> None:
        self._check_drives()
        self._check_times()
        self._check_blocks()
        self._check_multisine()

    def samples(self, sample_rate: float) -> int:
        """Count the samples of the duration.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to duration times rate.
        """
        return round(self.duration_seconds * sample_rate)

    def fade_samples(self, sample_rate: float) -> int:
        """Count the samples of one fade.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to fade times rate.
        """
        return round(self.fade_seconds * sample_rate)

    def _check_drives(self) -> None:
        field = f"excitation.{self.level_kind.value}"
        if not self.levels or len(self.levels) != len(self.spectra):
            raise SettingError(
                f"{len(self.levels)} levels and {len(self.spectra)} spectra were given; give one of each for every "
                "drive.",
                field=field,
            )
        for index, level in enumerate(self.levels):
            if not 0.0 < level <= LARGEST_LEVEL:
                name = "RMS" if self.level_kind is LevelKind.RMS else "peak"
                raise SettingError(
                    f"The {name} of drive {index} is {level}; every level must be greater than 0 and at most "
                    f"{LARGEST_LEVEL:g}.",
                    field=field,
                )
        first = self.spectra[0]
        for index, spectrum in enumerate(self.spectra):
            if (spectrum.lowest_frequency, spectrum.highest_frequency) != (
                first.lowest_frequency,
                first.highest_frequency,
            ):
                raise SettingError(
                    f"The PSD of drive {index} spans {spectrum.lowest_frequency:g} to {spectrum.highest_frequency:g} "
                    f"Hz, that of drive 0 {first.lowest_frequency:g} to {first.highest_frequency:g} Hz; a line is "
                    "identified only where every drive is excited, so give all the same band, with a low density where "
                    "need be.",
                    field="excitation.drive_spectra",
                )

    def _check_times(self) -> None:
        if not 0.0 < self.duration_seconds < np.inf:
            raise SettingError(
                f"The excitation lasts {self.duration_seconds} s; it must be finite and greater than 0.",
                field="excitation.duration_seconds",
            )
        if not 0.0 <= self.fade_seconds < self.duration_seconds / 2.0:
            raise SettingError(
                f"The fade lasts {self.fade_seconds} s; it must be 0 or more and less than half the excitation, "
                f"{self.duration_seconds / 2.0:g} s.",
                field="excitation.fade_seconds",
            )
        if not _is_whole(self.seed) or not 0 <= self.seed < 2**64:
            raise SettingError(
                f"The seed is {self.seed}; it must be a whole number from 0 to 2^64 - 1.", field="excitation.seed"
            )

    def _check_blocks(self) -> None:
        block = self.block_samples
        if not _is_whole(block) or block < SMALLEST_BLOCK_SAMPLES or block % 2 != 0:
            raise SettingError(
                f"The block has {block} samples; it must be a whole, even number, {SMALLEST_BLOCK_SAMPLES} or more.",
                field="estimator.block_samples",
            )
        try:
            hop_samples(block, self.overlap)
        except ValueError as error:
            raise SettingError(str(error), field="estimator.overlap") from error
        for name, value in (
            ("delay_blocks", self.delay_blocks),
            ("capture_blocks", self.capture_blocks),
            ("repeats", self.repeats),
            ("realisations", 1 if self.realisations is None else self.realisations),
        ):
            if not _is_whole(value) or value < 0 or (self.kind.is_multisine and value < 1):
                raise SettingError(
                    f"{name} is {value}; it must be a whole number, 1 or more"
                    + (": without a delay the transient stays in the capture." if name == "delay_blocks" else "."),
                    field=f"excitation.{name}",
                )
        if not 0.0 < self.burst_share <= 1.0:
            raise SettingError(
                f"A burst fills {self.burst_share} of its block; it must fill more than 0 and at most 1.",
                field="excitation.burst_share",
            )

    def _check_multisine(self) -> None:
        if not 0.0 <= self.detection_share <= LARGEST_DETECTION_SHARE:
            raise SettingError(
                f"A share of {self.detection_share} of the lines is left out for detection; it must be from 0 to "
                f"{LARGEST_DETECTION_SHARE:g}.",
                field="excitation.detection_share",
            )
        for name, asked in (
            ("odd_lines", self.odd_lines),
            ("detection_share", self.detection_share > 0.0),
            ("minimise_crest_factor", self.minimise_crest_factor),
        ):
            if asked and not self.kind.is_multisine:
                raise SettingError(
                    f"{name} is set for {self.kind.value}; only a multisine kind has lines and phases to choose, "
                    "so take one or leave it out.",
                    field=f"excitation.{name}",
                )


def _is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
