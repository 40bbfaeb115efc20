"""Running cross-spectra of two records that arrive in pieces, in bounded memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.block_spectra import BlockSpectra, NotFiniteError, density_scale
from duralab_spectra.blocks import hop_samples, independent_averages
from duralab_spectra.lines import line_frequencies
from duralab_spectra.records import matching_records, matching_shapes, require_sample_rate
from duralab_spectra.windows import hann_periodic

# Lines of a Hann-windowed constant: it does not affect the others.
_LINES_OF_A_MEAN = 2
# Number of lines whose spectra, products and sums fit the second cache together.
_LINES_TOGETHER = 128


@dataclass(frozen=True)
class SpectraEstimate:
    """Averaged one-sided spectra of two records `a` and `b`; densities, product of both units per Hz.

    Parameters
    ----------
    frequency
        Frequencies of the lines, shape (lines), in hertz.
    s_ab
        Complex, shape (lines, n_a, n_b): ``E[A B^H]``.
    s_bb
        Complex, shape (lines, n_b, n_b): ``E[B B^H]``.
    auto_a
        Real, shape (lines, n_a): the diagonal of ``E[A A^H]``.
    blocks
        Number of averaged blocks.
    independent_averages
        Equivalent number of independent blocks (Welch's formula).
    s_aa
        Complex, shape (lines, n_a, n_a): ``E[A A^H]``; None if it was not requested.
    """

    frequency: NDArray[np.float64]
    s_ab: NDArray[np.complex128]
    s_bb: NDArray[np.complex128]
    auto_a: NDArray[np.float64]
    blocks: int
    independent_averages: float
    s_aa: NDArray[np.complex128] | None = None


class CrossSpectra:
    """Running estimate of ``S_ab``, ``S_bb`` and the auto-spectra of `a`, fed piece by piece in bounded memory.

    With `a` the responses and `b` the drives, one pass gives all data for H1 and the multiple coherence.

    Parameters
    ----------
    n_a, n_b
        Numbers of channels of the two records, 1 or more.
    block_samples
        Number of samples in a block, even, 2 or more; windowed with the periodic Hann window, without detrending.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        Sample rate in hertz, greater than 0.
    full
        Whether all of ``S_aa`` is averaged, not only its diagonal: H2 and total least squares need it.
    without_mean
        Whether each channel's mean over all samples is removed; the estimate is as if it had been removed before.
    chosen
        Range of one or more averaged lines; all if omitted. Not together with `without_mean`.
    further
        Number of the last channels of `b`, 0 up to but not including `n_b`, that do not change the others: their
        averages have the same bytes as without these channels. Not together with `full`.

    Raises
    ------
    ValueError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        n_a: int,
        n_b: int,
        *,
        block_samples: int,
        overlap: float,
        sample_rate: float,
        full: bool = False,
        without_mean: bool = False,
        chosen: slice | None = None,
        further: int = 0,
    ) -> None:
        if n_a < 1 or n_b < 1:
            raise ValueError(f"The records have {n_a} and {n_b} channels; both need at least one.")
        if not 0 <= further < n_b or (further and full):
            raise ValueError(
                f"There are {further} further channels; allowed are 0 to {n_b - 1}, and none where S_aa is averaged."
            )
        require_sample_rate(sample_rate)
        self._hop = hop_samples(block_samples, overlap)
        self._block_samples = block_samples
        self._sample_rate = sample_rate
        self._window = hann_periodic(block_samples)
        kept = range(block_samples // 2 + 1) if chosen is None else range(block_samples // 2 + 1)[chosen]
        if not kept or kept.step != 1:
            raise ValueError(f"The chosen lines are {chosen}; they must be one or more lines next to each other.")
        if chosen is not None and without_mean:
            raise ValueError("The mean comes off where all lines are averaged; ask for one of the two.")
        self._chosen = slice(kept.start, kept.stop)
        own = n_a + n_b - further
        self._spectra = BlockSpectra(
            self._window, hop=self._hop, channels=own, chosen=self._chosen, powered=n_a, further=further
        )
        self._n_a = n_a
        self._full, self._without_mean = full, without_mean
        self._tail = np.empty((n_a + n_b, 0))
        lines, first = len(kept), 0 if full else n_a
        self._products = np.zeros((lines, n_a + n_b, n_a + n_b - first), dtype=np.complex128)
        self._own, self._first_column = own, first
        blocks, parts = self._spectra.blocks_in_chunk, [(own, slice(first, own))]
        if further:
            parts.append((n_a + n_b, slice(own, n_a + n_b)))
        #: Rows and columns whose products are computed together, with memory for the conjugates and the products.
        self._parts = [
            (
                slice(rows),
                columns,
                np.empty((_LINES_TOGETHER, columns.stop - columns.start, blocks), dtype=np.complex128),
                np.empty((_LINES_TOGETHER, rows, columns.stop - columns.start), dtype=np.complex128),
            )
            for rows, columns in parts
        ]
        self._lowest_lines = np.zeros((min(_LINES_OF_A_MEAN, lines), n_a + n_b), dtype=np.complex128)
        self._sums, self._samples = np.zeros(n_a + n_b), 0
        self._blocks, self._stretch_blocks, self._independent = 0, 0, 0.0

    @property
    def blocks(self) -> int:
        """Number of blocks averaged so far."""
        return self._blocks

    def add(self, a: ArrayLike, b: ArrayLike) -> None:
        """Add the next samples of both records; samples that do not fill a block wait for the next call.

        Parameters
        ----------
        a
            Record `a`, shape (n_a, samples).
        b
            Record `b`, shape (n_b, samples), sampled at the same instants.

        Raises
        ------
        ValueError
            If the shapes do not agree or a value is not finite. Whole blocks before that value may have been added; the
            next samples then do not continue the previous ones.
        """
        first, second = matching_shapes(a, b)
        try:
            self.add_checked(first, second)
        except NotFiniteError:
            self.end_stretch()
            matching_records(first, second)  # its error states which value
            raise

    def add_checked(self, first: NDArray[np.float64], second: NDArray[np.float64]) -> None:
        """Add the next samples of two records that `as_record` has checked: their values are not checked again.

        Parameters
        ----------
        first
            Record `a`, shape (n_a, samples), finite.
        second
            Record `b`, shape (n_b, samples), finite, sampled at the same instants.

        Raises
        ------
        ValueError
            If the channels are not those of the estimate.
        NotFiniteError
            If a value is not finite after all.
        """
        expected = (self._n_a, self._tail.shape[0] - self._n_a)
        if (first.shape[0], second.shape[0]) != expected:
            raise ValueError(
                f"The records have {first.shape[0]} and {second.shape[0]} channels; "
                f"this estimate was made for {expected[0]} and {expected[1]}."
            )
        if self._without_mean:
            # At the speed of memory: numpy's own sum along rows takes twice as long.
            sums = np.concatenate((np.einsum("cs->c", first), np.einsum("cs->c", second)))
            if not np.isfinite(sums).all():
                raise NotFiniteError
            self._sums += sums
            self._samples += first.shape[1]
        waiting = self._tail.shape[1]
        skip = 0
        if waiting:
            # Blocks that begin in the waiting samples; all later ones are views of the new records.
            reach = min(first.shape[1], self._block_samples - 1)
            joined = np.concatenate((self._tail, np.concatenate((first[:, :reach], second[:, :reach]))), axis=1)
            taken = self._take(joined[: self._n_a], joined[self._n_a :]) * self._hop
            if taken < waiting:
                self._wait_with(joined[:, taken:])
                return
            skip = taken - waiting
        rest_a, rest_b = first[:, skip:], second[:, skip:]
        taken = self._take(rest_a, rest_b) * self._hop
        self._wait_with(np.concatenate((rest_a[:, taken:], rest_b[:, taken:])))

    def end_stretch(self) -> None:
        """Discard samples that do not fill a block: the next samples do not continue the previous ones."""
        self._independent += self._independent_of_stretch()
        self._stretch_blocks = 0
        self._tail = self._tail[:, :0]

    def estimate(self) -> SpectraEstimate:
        """Return the averages of all whole blocks so far.

        Returns
        -------
        SpectraEstimate
            Estimate with its own arrays; later calls of `add` do not change it.

        Raises
        ------
        ValueError
            If no block is complete.
        """
        if self._blocks == 0:
            raise ValueError(
                f"The records are shorter than one block of {self._block_samples} samples; take shorter blocks."
            )
        own, first = self._own, self._first_column
        # Further channels with the others: only their products the other way round are averaged.
        mirrored = self._products[:, self._n_a : own, own - first :]
        self._products[:, own:, self._n_a - first : own - first] = mirrored.conj().transpose(0, 2, 1)
        scale = density_scale(self._window, self._sample_rate, self._blocks)[self._chosen]
        of_a, of_b = slice(self._n_a), slice(self._n_a, None)
        return SpectraEstimate(
            frequency=line_frequencies(self._block_samples, self._sample_rate)[self._chosen],
            s_ab=self._densities(scale, of_a, of_b),
            s_bb=self._densities(scale, of_b, of_b),
            auto_a=self._powers_of_a(scale),
            blocks=self._blocks,
            independent_averages=self._independent + self._independent_of_stretch(),
            s_aa=self._densities(scale, of_a, of_a) if self._full else None,
        )

    def _densities(self, scale: NDArray[np.float64], rows: slice, columns: slice) -> NDArray[np.complex128]:
        """Return the averages of some channels with others; columns of `a` only if they are averaged."""
        channels, first = self._tail.shape[0], self._first_column
        kept = slice(columns.indices(channels)[0] - first, columns.indices(channels)[1] - first)
        densities = self._products[:, rows, kept] * scale[:, None, None]
        if self._without_mean:
            correction = self._products_of_mean()[:, rows, columns]
            low = correction.shape[0]
            densities[:low] -= correction * scale[:low, None, None]
        return densities

    def _powers_of_a(self, scale: NDArray[np.float64]) -> NDArray[np.float64]:
        powers = self._spectra.power * scale[:, None]
        if self._without_mean:
            correction = np.einsum("fii->fi", self._products_of_mean()).real[:, : self._n_a]
            low = correction.shape[0]
            powers[:low] -= correction * scale[:low, None]
        return np.maximum(powers, 0.0)

    def _take(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> int:
        """Average all whole blocks and count them."""
        blocks = 0
        for lines in self._spectra.chunks(a, b):
            for start in range(0, lines.shape[0], _LINES_TOGETHER):
                self._add_products(lines[start : start + _LINES_TOGETHER], self._products[start:])
            if self._without_mean:
                self._lowest_lines += np.sum(lines[: self._lowest_lines.shape[0]], axis=2)
            self._blocks += lines.shape[2]
            self._stretch_blocks += lines.shape[2]
            blocks += lines.shape[2]
        return blocks

    def _add_products(self, lines: NDArray[np.complex128], products: NDArray[np.complex128]) -> None:
        """Add the products of some lines."""
        count, _, blocks = lines.shape
        for rows, columns, conjugate, product in self._parts:
            right, found = conjugate[:count, :, :blocks], product[:count]
            np.conjugate(lines[:, columns], out=right)
            np.matmul(lines[:, rows], right.transpose(0, 2, 1), out=found)
            first = self._first_column
            products[:count, rows, columns.start - first : columns.stop - first] += found

    def _wait_with(self, tail: NDArray[np.float64]) -> None:
        if not np.isfinite(tail).all():
            raise NotFiniteError
        self._tail = tail

    def _products_of_mean(self) -> NDArray[np.complex128]:
        """Return the contribution of the means ``m``: ``XX^H - (X - mW)(X - mW)^H = X (mW)^H + mW X^H - mW (mW)^H``."""
        low = self._lowest_lines.shape[0]
        constant = np.fft.rfft(self._window)[:low, None] * (self._sums / max(self._samples, 1))
        mixed = self._lowest_lines[:, :, None] * constant[:, None, :].conj()
        return (
            mixed + mixed.conj().transpose(0, 2, 1) - self._blocks * constant[:, :, None] * constant[:, None, :].conj()
        )

    def _independent_of_stretch(self) -> float:
        if self._stretch_blocks == 0:
            return 0.0
        return independent_averages(self._window, self._hop, self._stretch_blocks)
