"""Averaged spectra of drives and responses over the used parts of a layout, piece by piece in bounded memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import CrossSpectra
from identifier.estimators.used_stretches import UsedStretches
from identifier.layout import Capture, Layout, Window


@dataclass(frozen=True)
class AveragedSpectra:
    """Averaged one-sided densities for the spectral estimators.

    `frequency`: Shape (lines), in hertz. `s_uu`: Complex, shape (lines, drives, drives). `s_yu`: Complex, shape (lines,
    responses, drives). `auto_y`: Shape (lines, responses): the diagonal of ``S_yy``. `blocks`: Blocks averaged.
    `independent_averages`: Equivalent independent averages: Welch's formula under a window; captures if the drive is
    periodic. `lines`: Shape (lines): the excited lines. `s_yy`: Complex, shape (lines, responses, responses); None
    if not requested.
    """

    frequency: NDArray[np.float64]
    s_uu: NDArray[np.complex128]
    s_yu: NDArray[np.complex128]
    auto_y: NDArray[np.float64]
    blocks: int
    independent_averages: float
    lines: NDArray[np.bool_]
    s_yy: NDArray[np.complex128] | None = None


class SpectralSums:
    """Running averages over the captures of a layout.

    Under a Hann window blocks overlap and each channel's mean over all captures is subtracted: under excitation the
    mean moves away from the value at rest, and a transducer's zero drifts. Without a window the mean stays at line 0.
    The periods of a capture are averaged before the transform if the drive is periodic.

    Parameters
    ----------
    layout
        Layout of the experiment.
    drives, responses
        Number of channels, 1 or more.
    full
        Whether all of ``S_yy`` is averaged, which H2 needs and which takes 1.5 times as long.
    """

    def __init__(self, layout: Layout, *, drives: int, responses: int, full: bool = False) -> None:
        self._layout = layout
        self._responses, self._full = responses, full
        self._used = UsedStretches(layout)
        self._welch = CrossSpectra(
            responses,
            drives,
            block_samples=layout.block_samples,
            overlap=layout.overlap,
            sample_rate=layout.sample_rate,
            full=full,
            without_mean=True,
        )
        channels = drives + responses
        self._block = np.zeros((channels, layout.block_samples))
        self._filled = 0
        self._products = np.zeros((layout.block_samples // 2 + 1, channels, channels), dtype=np.complex128)
        self._blocks = self._averages = 0

    def add(self, drive: NDArray[np.float64], response: NDArray[np.float64]) -> None:
        """Add the next samples of the whole record, fades and delay blocks included.

        Parameters
        ----------
        drive
            Shape (drives, samples), as returned by `duralab_spectra.as_record`: finite, which is not checked again.
        response
            Shape (responses, samples), as for the drive, sampled at the same instants.

        Raises
        ------
        ValueError
            The record is longer than its layout or has other channels.
        """
        for capture, piece, ends in self._used.next_pieces(drive.shape[1]):
            if self._layout.window is Window.HANN:
                self._welch.add_checked(response[:, piece], drive[:, piece])
                if ends:
                    self._welch.end_stretch()
            else:
                self._add_periods(capture, np.concatenate((response[:, piece], drive[:, piece])))

    def averages(self) -> AveragedSpectra:
        """Return the averages so far.

        Returns
        -------
        AveragedSpectra
            Averages with their own arrays.

        Raises
        ------
        ValueError
            No block is complete.
        """
        n_y, layout = self._responses, self._layout
        if layout.window is Window.HANN:
            welch = self._welch.estimate()
            return AveragedSpectra(
                frequency=welch.frequency,
                s_uu=welch.s_bb,
                s_yu=welch.s_ab,
                auto_y=welch.auto_a,
                blocks=welch.blocks,
                independent_averages=welch.independent_averages,
                lines=layout.excited,
                s_yy=welch.s_aa,
            )
        if self._blocks == 0:
            raise ValueError(f"The record ends before its first block of {layout.block_samples} samples is complete.")
        scale = np.full(self._products.shape[0], 2.0 / (layout.sample_rate * layout.block_samples * self._blocks))
        scale[[0, -1]] *= 0.5  # the mean and the Nyquist line have no negative frequency
        density = self._products * scale[:, None, None]
        return AveragedSpectra(
            frequency=layout.frequency,
            s_uu=np.ascontiguousarray(density[:, n_y:, n_y:]),
            s_yu=np.ascontiguousarray(density[:, :n_y, n_y:]),
            auto_y=np.ascontiguousarray(np.einsum("fii->fi", density[:, :n_y, :n_y]).real),
            blocks=self._blocks,
            independent_averages=float(self._averages),
            lines=layout.excited,
            s_yy=np.ascontiguousarray(density[:, :n_y, :n_y]) if self._full else None,
        )

    def _add_periods(self, capture: Capture, samples: NDArray[np.float64]) -> None:
        """Fold a piece onto the block; a complete block, or the mean of a capture's periods, is transformed."""
        block = self._layout.block_samples
        together = capture.periods if self._layout.periodic else 1
        start = 0
        while start < samples.shape[1]:
            place = self._filled % block
            count = min(block - place, samples.shape[1] - start)
            self._block[:, place : place + count] += samples[:, start : start + count]
            self._filled += count
            start += count
            if self._filled == together * block:
                lines = np.fft.rfft(self._block / together, axis=1).T
                # The mean of P periods has a P-th of the noise, so its weight is P blocks.
                self._products += together * lines[:, :, None] * lines[:, None, :].conj()
                self._blocks += together
                self._averages += 1
                self._block[:] = 0.0
                self._filled = 0
