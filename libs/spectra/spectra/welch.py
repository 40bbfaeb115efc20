"""Welch cross-spectrum matrices: chunks of windowed blocks, real FFTs, one contiguous matrix product per chunk."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spectra.blocks import count_blocks, hop_samples, independent_averages
from spectra.lines import line_frequencies
from spectra.records import as_record, require_sample_rate
from spectra.transforms import forward
from spectra.windows import hann_periodic

# Spectra of one chunk: measured fastest while they fit the second cache and the allocator reuses their memory.
_CHUNK_BYTES = 2**20


@dataclass(frozen=True)
class SpectraEstimate:
    """Averaged one-sided spectra of two records `a` and `b`; densities, unit of the one times unit of the other per Hz.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz.
    s_ab
        Complex, shape (lines, n_a, n_b): ``E[A B^H]``.
    s_bb
        Complex, shape (lines, n_b, n_b): ``E[B B^H]``.
    auto_a
        Real, shape (lines, n_a): the diagonal of ``E[A A^H]``.
    blocks
        Blocks averaged.
    independent_averages
        Equivalent independent blocks (Welch's formula).
    """

    frequency: NDArray[np.float64]
    s_ab: NDArray[np.complex128]
    s_bb: NDArray[np.complex128]
    auto_a: NDArray[np.float64]
    blocks: int
    independent_averages: float


class CrossSpectra:
    """Running estimate of ``S_ab``, ``S_bb`` and the auto-spectra of `a`, fed piece by piece in bounded memory.

    With `a` the responses and `b` the drives it holds all that H1 and the multiple coherence need, from one pass.

    Parameters
    ----------
    n_a, n_b
        Channels of the two records, 1 or more.
    block_samples
        Samples in a block, even, 2 or more; windowed with the periodic Hann window. Nothing is detrended.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        In hertz, greater than 0.

    Raises
    ------
    ValueError
        Where a parameter is not allowed.
    """

    def __init__(self, n_a: int, n_b: int, *, block_samples: int, overlap: float, sample_rate: float) -> None:
        if n_a < 1 or n_b < 1:
            raise ValueError(f"The records have {n_a} and {n_b} channels; both need at least one.")
        require_sample_rate(sample_rate)
        self._hop = hop_samples(block_samples, overlap)
        self._block_samples = block_samples
        self._sample_rate = sample_rate
        self._window = hann_periodic(block_samples)
        self._chunk_blocks = _blocks_in_chunk(block_samples, max(n_a, n_b))
        self._tail_a = np.empty((n_a, 0))
        self._tail_b = np.empty((n_b, 0))
        lines = block_samples // 2 + 1
        self._s_ab = np.zeros((lines, n_a, n_b), dtype=np.complex128)
        self._s_bb = np.zeros((lines, n_b, n_b), dtype=np.complex128)
        self._auto_a = np.zeros((lines, n_a))
        self._blocks = 0

    @property
    def blocks(self) -> int:
        """Blocks averaged so far."""
        return self._blocks

    def add(self, a: ArrayLike, b: ArrayLike) -> None:
        """Add the next samples of both records; what does not fill a block waits for the next call.

        Parameters
        ----------
        a
            Shape (n_a, samples).
        b
            Shape (n_b, samples), sampled at the same instants.

        Raises
        ------
        ValueError
            Where the shapes do not agree or a value is not finite.
        """
        first, second = _matching_records(a, b)
        expected = (self._tail_a.shape[0], self._tail_b.shape[0])
        if (first.shape[0], second.shape[0]) != expected:
            raise ValueError(
                f"The records have {first.shape[0]} and {second.shape[0]} channels; "
                f"this estimate was made for {expected[0]} and {expected[1]}."
            )
        start = 0
        while start < first.shape[1]:
            # Just what completes a chunk: memory stays bounded and no chunk is left with a block or two.
            missing = (self._chunk_blocks - 1) * self._hop + self._block_samples - self._tail_a.shape[1]
            stop = min(first.shape[1], start + missing)
            self._take(
                np.concatenate((self._tail_a, first[:, start:stop]), axis=1),
                np.concatenate((self._tail_b, second[:, start:stop]), axis=1),
            )
            start = stop

    def estimate(self) -> SpectraEstimate:
        """Return the averages of all whole blocks so far.

        Returns
        -------
        SpectraEstimate
            Owns its arrays; later calls of `add` do not change it.

        Raises
        ------
        ValueError
            Where not one block is complete.
        """
        if self._blocks == 0:
            raise ValueError(
                f"The records are shorter than one block of {self._block_samples} samples; take shorter blocks."
            )
        scale = _density_scale(self._window, self._sample_rate, self._blocks)
        return SpectraEstimate(
            frequency=line_frequencies(self._block_samples, self._sample_rate),
            s_ab=self._s_ab * scale[:, None, None],
            s_bb=self._s_bb * scale[:, None, None],
            auto_a=self._auto_a * scale[:, None],
            blocks=self._blocks,
            independent_averages=independent_averages(self._window, self._hop, self._blocks),
        )

    def _take(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
        """Average all whole blocks of at most one chunk; keep what later blocks still need."""
        blocks = 0
        for a_lines, b_lines in zip(
            _block_spectra(a, self._window, self._hop, self._chunk_blocks),
            _block_spectra(b, self._window, self._hop, self._chunk_blocks),
            strict=True,
        ):
            b_conjugate = _conjugate_transpose(b_lines)
            self._s_ab += np.matmul(a_lines, b_conjugate)
            self._s_bb += np.matmul(b_lines, b_conjugate)
            self._auto_a += _power(a_lines)
            blocks += a_lines.shape[2]
        self._blocks += blocks
        self._tail_a = a[:, blocks * self._hop :].copy()
        self._tail_b = b[:, blocks * self._hop :].copy()


def cross_spectra(
    a: ArrayLike, b: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float
) -> NDArray[np.complex128]:
    """Cross-spectrum matrix ``S_ab = E[A B^H]`` by Welch's method: periodic Hann window, nothing detrended.

    Parameters
    ----------
    a
        Shape (n_a, samples).
    b
        Shape (n_b, samples), sampled at the same instants.
    block_samples
        Samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        In hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Complex, shape (lines, n_a, n_b), one-sided density, unit of `a` times unit of `b` per Hz. Element ``[:, i, j]``
        is ``scipy.signal.csd(b[j], a[i], detrend=False)``, which conjugates its first argument.

    Raises
    ------
    ValueError
        Where the records do not agree, are shorter than a block, or a parameter is not allowed.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*, sections 8.5 and 11.5.
    """
    first, second = _matching_records(a, b)
    window, hop, blocks = _blocking(first.shape[1], block_samples, overlap, sample_rate)
    chunk = _blocks_in_chunk(block_samples, max(first.shape[0], second.shape[0]))
    total = np.zeros((block_samples // 2 + 1, first.shape[0], second.shape[0]), dtype=np.complex128)
    for a_lines, b_lines in zip(
        _block_spectra(first, window, hop, chunk), _block_spectra(second, window, hop, chunk), strict=True
    ):
        total += np.matmul(a_lines, _conjugate_transpose(b_lines))
    return total * _density_scale(window, sample_rate, blocks)[:, None, None]


def paired_spectra(
    a: ArrayLike, b: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float
) -> NDArray[np.complex128]:
    """Cross-spectra of matching channels only: the diagonal of `cross_spectra`, without the rest.

    Parameters
    ----------
    a
        Shape (channels, samples).
    b
        Shape (channels, samples), sampled at the same instants.
    block_samples
        Samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        In hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Complex, shape (lines, channels): ``E[A_i conj(B_i)]``, one-sided density. Real where `a` is `b`.

    Raises
    ------
    ValueError
        Where the records do not agree, are shorter than a block, or a parameter is not allowed.
    """
    first, second = _matching_records(a, b)
    if first.shape[0] != second.shape[0]:
        raise ValueError(
            f"The records have {first.shape[0]} and {second.shape[0]} channels; pairs need as many in both."
        )
    window, hop, blocks = _blocking(first.shape[1], block_samples, overlap, sample_rate)
    chunk = _blocks_in_chunk(block_samples, max(first.shape[0], second.shape[0]))
    total = np.zeros((block_samples // 2 + 1, first.shape[0]), dtype=np.complex128)
    for a_lines, b_lines in zip(
        _block_spectra(first, window, hop, chunk), _block_spectra(second, window, hop, chunk), strict=True
    ):
        total += np.sum(a_lines * b_lines.conj(), axis=2)
    return total * _density_scale(window, sample_rate, blocks)[:, None]


def auto_spectra(a: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float) -> NDArray[np.float64]:
    """Power spectral density of each channel by Welch's method: periodic Hann window, nothing detrended.

    Parameters
    ----------
    a
        Shape (channels, samples).
    block_samples
        Samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        In hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Real, shape (lines, channels), one-sided, the channel's unit squared per Hz.

    Raises
    ------
    ValueError
        Where the record is shorter than a block or a parameter is not allowed.
    """
    record = as_record(a, name="a")
    window, hop, blocks = _blocking(record.shape[1], block_samples, overlap, sample_rate)
    total = np.zeros((block_samples // 2 + 1, record.shape[0]))
    for lines in _block_spectra(record, window, hop, _blocks_in_chunk(block_samples, record.shape[0])):
        total += _power(lines)
    return total * _density_scale(window, sample_rate, blocks)[:, None]


def _matching_records(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, second = as_record(a, name="a"), as_record(b, name="b")
    if first.shape[1] != second.shape[1]:
        raise ValueError(f"The records have {first.shape[1]} and {second.shape[1]} samples; both need as many.")
    return first, second


def _blocking(
    samples: int, block_samples: int, overlap: float, sample_rate: float
) -> tuple[NDArray[np.float64], int, int]:
    require_sample_rate(sample_rate)
    blocks = count_blocks(samples, block_samples, overlap)
    if blocks == 0:
        raise ValueError(
            f"The records have {samples} samples, fewer than one block of {block_samples}; take shorter blocks."
        )
    return hann_periodic(block_samples), hop_samples(block_samples, overlap), blocks


def _block_spectra(
    samples: NDArray[np.float64], window: NDArray[np.float64], hop: int, chunk: int
) -> Iterator[NDArray[np.complex128]]:
    """Yield the spectra of successive chunks of blocks, contiguous, shape (lines, channels, blocks of the chunk)."""
    if samples.shape[1] < window.size:
        return
    frames = np.lib.stride_tricks.sliding_window_view(samples, window.size, axis=1)[:, ::hop]
    for start in range(0, frames.shape[1], chunk):
        spectrum = forward(frames[:, start : start + chunk] * window)
        # The matrix product runs ten times slower on a view with a foreign layout than this copy takes.
        yield np.ascontiguousarray(spectrum.transpose(2, 0, 1))


def _blocks_in_chunk(block_samples: int, channels: int) -> int:
    return max(1, _CHUNK_BYTES // (8 * block_samples * channels))


def _conjugate_transpose(lines: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return np.ascontiguousarray(lines.conj().transpose(0, 2, 1))


def _power(lines: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Sum of the squared magnitudes over the blocks, read as pairs of reals so that nothing is copied."""
    parts = lines.view(np.float64)
    return np.einsum("fck,fck->fc", parts, parts)


def _density_scale(window: NDArray[np.float64], sample_rate: float, blocks: int) -> NDArray[np.float64]:
    lines = window.size // 2 + 1
    scale = np.full(lines, 2.0 / (sample_rate * float(window @ window) * blocks))
    scale[[0, -1]] *= 0.5  # the mean and the Nyquist line have no negative twin
    return scale
