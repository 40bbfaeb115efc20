"""Spectra of the blocks of records, a few blocks of all channels at a time, laid out for a matrix product per line."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

# Size of one channel's windowed blocks. Measured on 2 + 2 to 16 + 16 channels: half of it is up to a tenth slower.
_CHANNEL_BYTES = 3 * 2**17
# Size of the spectra of all channels: larger ones multiply no faster and take more memory.
_SPECTRA_BYTES = 3 * 2**21


class NotFiniteError(ValueError):
    """A record holds a value that is not finite; the error of `as_record` states where."""

    def __init__(self) -> None:
        super().__init__("A value of a record is not finite.")


class BlockSpectra:
    """Windowing and transform of whole blocks; its memory is allocated once and reused for every chunk.

    `window`: Shape (block samples). `hop`: Samples between the starts of neighbouring blocks, 1 or more. `channels`:
    Number of channels of all records together, 1 or more. `chosen`: Range of the kept lines; all if omitted.
    `powered`: Number of first channels whose power is summed, 0 to `channels`. `further`: Number of channels beyond
    those, which do not change the number of blocks in a chunk.
    """

    def __init__(
        self,
        window: NDArray[np.float64],
        *,
        hop: int,
        channels: int,
        chosen: slice | None = None,
        powered: int = 0,
        further: int = 0,
    ) -> None:
        block, lines = window.size, window.size // 2 + 1
        self._window = window
        self._hop = hop
        self._chosen = slice(None) if chosen is None else chosen
        self.blocks_in_chunk = max(1, min(_CHANNEL_BYTES // (8 * block), _SPECTRA_BYTES // (16 * lines * channels)))
        self._windowed = np.empty((self.blocks_in_chunk, block))
        self._spectra = np.empty((self.blocks_in_chunk, lines), dtype=np.complex128)
        kept = len(range(lines)[self._chosen])
        self.power = np.zeros((kept, powered))
        """Squared magnitudes of the first channels, summed over all blocks so far; shape (lines kept, powered)."""
        self._power_of_chunk = np.empty_like(self.power)
        self._by_line = np.empty((kept, channels + further, self.blocks_in_chunk), dtype=np.complex128)

    def chunks(self, *records: NDArray[np.float64]) -> Iterator[NDArray[np.complex128]]:
        """Yield the spectra of the whole blocks of records that were sampled together."""
        block = self._window.size
        if records[0].shape[1] < block:
            return
        view = np.lib.stride_tricks.sliding_window_view
        frames = [view(channel, block)[:: self._hop] for record in records for channel in record]
        for start in range(0, frames[0].shape[0], self.blocks_in_chunk):
            # Values that are not finite are found below, with an error instead of a warning.
            with np.errstate(invalid="ignore", over="ignore"):
                by_line = self._transformed([of_channel[start : start + self.blocks_in_chunk] for of_channel in frames])
            # Every line depends on every sample: one of them shows such a value, and the record is not read for it
            # again.
            if not np.isfinite(by_line[0]).all():
                raise NotFiniteError
            self.power += self._power_of_chunk
            yield by_line

    def _transformed(self, frames: list[NDArray[np.float64]]) -> NDArray[np.complex128]:
        blocks = frames[0].shape[0]
        windowed, spectra, by_line = self._windowed[:blocks], self._spectra[:blocks], self._by_line
        if blocks < self.blocks_in_chunk:
            by_line = np.empty((*by_line.shape[:2], blocks), dtype=np.complex128)
        for channel, of_channel in enumerate(frames):
            np.multiply(of_channel, self._window, out=windowed)
            # numpy's transform writes into existing memory; fresh pages would cost more than the transform.
            np.fft.rfft(windowed, axis=-1, out=spectra)
            if channel < self.power.shape[1]:
                self._take_power(channel, spectra[:, self._chosen])
            # The product at each line would be ten times slower on another layout than this copy.
            by_line[:, channel] = spectra[:, self._chosen].T
        return by_line

    def _take_power(self, channel: int, spectra: NDArray[np.complex128]) -> None:
        """Sum squares along the lines, while they are in the second cache; read as reals, so that nothing is copied."""
        parts = spectra.view(np.float64)
        squares = np.einsum("kl,kl->l", parts, parts)
        np.add(squares[0::2], squares[1::2], out=self._power_of_chunk[:, channel])


def density_scale(window: NDArray[np.float64], sample_rate: float, blocks: int) -> NDArray[np.float64]:
    """Return the factors from sums of products of block spectra to one-sided densities."""
    lines = window.size // 2 + 1
    scale = np.full(lines, 2.0 / (sample_rate * float(window @ window) * blocks))
    scale[[0, -1]] *= 0.5  # the lines of the mean and of the Nyquist frequency have no negative counterpart
    return scale
