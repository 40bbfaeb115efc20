"""Samples of a drive's record that identify a rig, and the lines that they excite."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import line_frequencies


class Window(Enum):
    """Weight on each block before its spectrum is taken."""

    HANN = "hann"
    """For excitations that continue over the block's edges; blocks may overlap."""
    NONE = "none"
    """For blocks that are periodic, or that begin and end at rest: they do not leak, and a window would only blur."""


@dataclass(frozen=True)
class Capture:
    """One uninterrupted used part of a record.

    Two captures of the same realisation and experiment are repeats: the same drive, played again.

    Parameters
    ----------
    start
        First used sample, 0 or more.
    periods
        Number of successive whole blocks, 1 or more; under a Hann window the blocks that fit without overlap.
    realisation
        Index of the independent draw of phases or noise, 0 or more.
    experiment
        Column of the decorrelation matrix within the realisation, 0 or more.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    start: int
    periods: int
    realisation: int
    experiment: int

    def __post_init__(self) -> None:
        if self.start < 0 or self.periods < 1 or self.realisation < 0 or self.experiment < 0:
            raise ValueError(
                f"A capture starts at sample {self.start} with {self.periods} periods, realisation {self.realisation}, "
                f"experiment {self.experiment}; it must have a period and no number below 0."
            )


@dataclass(frozen=True)
class Layout:
    """Layout of a drive for the estimator: all data except its samples.

    Parameters
    ----------
    samples
        Number of samples of the whole drive, including fades.
    sample_rate
        Sample rate in hertz, greater than 0.
    block_samples
        Number of samples in a block, even, 2 or more; of a periodic excitation its period.
    fade_samples
        Number of samples of each linear fade, 0 or more; never inside a capture.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1; 0 without a window.
    periodic
        Whether the drive repeats itself every block within a capture.
    delay_blocks
        Number of periods played and dropped before each capture, 0 or more.
    captures
        Captures in order of time, not overlapping, one or more.
    lowest, highest
        Band, in hertz, both included.
    excited
        Shape (block_samples // 2 + 1): lines on which every drive has power.
    detection
        Same shape: lines of the band that are left out on purpose, to detect distortion there.
    window
        Window of the blocks; `Window.NONE` if the excitation is periodic.

    Raises
    ------
    ValueError
        The values contradict each other.
    """

    samples: int
    sample_rate: float
    block_samples: int
    fade_samples: int
    overlap: float
    periodic: bool
    delay_blocks: int
    captures: tuple[Capture, ...]
    lowest: float
    highest: float
    excited: NDArray[np.bool_]
    detection: NDArray[np.bool_]
    window: Window

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check_lines()
        self._check_captures()

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Lines of the block grid, shape (block_samples // 2 + 1), in hertz."""
        return line_frequencies(self.block_samples, self.sample_rate)

    def samples_of(self, capture: Capture) -> int:
        """Return the number of samples of a capture.

        Parameters
        ----------
        capture
            One of `captures`.

        Returns
        -------
        int
            Its whole blocks without a window; under a Hann window all samples to the next capture or to the last fade.
        """
        if self.window is Window.NONE:
            return capture.periods * self.block_samples
        later = [other.start for other in self.captures if other.start > capture.start]
        return min(later, default=self.samples - self.fade_samples) - capture.start

    def _check_numbers(self) -> None:
        if not 0.0 < self.sample_rate < np.inf:
            raise ValueError(f"The sample rate is {self.sample_rate} Hz; it must be finite and greater than 0.")
        if self.block_samples < 2 or self.block_samples % 2 != 0:
            raise ValueError(f"A block has {self.block_samples} samples; it must be even, 2 or more.")
        if self.fade_samples < 0 or self.delay_blocks < 0 or not 0.0 <= self.overlap < 1.0:
            raise ValueError(
                f"{self.fade_samples} fade samples, {self.delay_blocks} delay blocks, overlap {self.overlap}; "
                "none may be below 0, and the overlap must be less than 1."
            )
        if self.window is Window.NONE and self.overlap != 0.0:
            raise ValueError(f"The overlap is {self.overlap}; blocks without a window do not overlap: take 0.")
        if self.periodic and self.window is not Window.NONE:
            raise ValueError("A periodic excitation has no leakage; its blocks are taken without a window.")

    def _check_lines(self) -> None:
        lines = (self.block_samples // 2 + 1,)
        if self.excited.shape != lines or self.detection.shape != lines:
            raise ValueError(
                f"The excited lines have shape {self.excited.shape}, the detection lines {self.detection.shape}; "
                f"blocks of {self.block_samples} samples have shape {lines}."
            )
        in_band = (self.frequency >= self.lowest) & (self.frequency <= self.highest)
        if not self.excited.any():
            raise ValueError(f"No line is excited from {self.lowest:g} to {self.highest:g} Hz; at least one must be.")
        if np.any((self.excited | self.detection) & ~in_band) or np.any(self.excited & self.detection):
            raise ValueError(
                f"Every excited or detection line must lie from {self.lowest:g} to {self.highest:g} Hz, "
                "and be one or the other."
            )

    def _check_captures(self) -> None:
        if not self.captures:
            raise ValueError("The layout has no capture; at least one stretch of the record must be used.")
        free = 0
        for capture in self.captures:
            length = self.samples_of(capture)
            if capture.start < free or capture.start + length > self.samples:
                raise ValueError(
                    f"A capture runs from sample {capture.start} to {capture.start + length}; it must begin after "
                    f"the one before, at {free} or later, and end within {self.samples} samples."
                )
            if length < capture.periods * self.block_samples:
                raise ValueError(
                    f"A capture of {length} samples does not hold {capture.periods} blocks of {self.block_samples}."
                )
            free = capture.start + length
