"""Welch spectra of whole records: periodic Hann window, no detrending."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.block_spectra import BlockSpectra, density_scale
from duralab_spectra.blocks import count_blocks, hop_samples
from duralab_spectra.records import as_record, matching_records, require_sample_rate
from duralab_spectra.windows import hann_periodic


def cross_spectra(
    a: ArrayLike, b: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float
) -> NDArray[np.complex128]:
    """Return the cross-spectrum matrix ``S_ab = E[A B^H]`` by Welch's method: periodic Hann window, no detrending.

    Parameters
    ----------
    a
        Record `a`, shape (n_a, samples).
    b
        Record `b`, shape (n_b, samples), sampled at the same instants.
    block_samples
        Number of samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Complex, shape (lines, n_a, n_b), one-sided density, unit of `a` times unit of `b` per Hz. Element ``[:, i, j]``
        is ``scipy.signal.csd(b[j], a[i], detrend=False)``, which conjugates its first argument.

    Raises
    ------
    ValueError
        If the records do not agree, are shorter than a block, or a parameter is not allowed.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*, sections 8.5 and 11.5.
    """
    first, second = matching_records(a, b)
    window, hop, blocks = _blocking(first.shape[1], block_samples, overlap, sample_rate)
    n_a, n_b = first.shape[0], second.shape[0]
    total = np.zeros((block_samples // 2 + 1, n_a, n_b), dtype=np.complex128)
    for lines in BlockSpectra(window, hop=hop, channels=n_a + n_b).chunks(first, second):
        total += np.matmul(lines[:, :n_a], lines[:, n_a:].conj().transpose(0, 2, 1))
    return total * density_scale(window, sample_rate, blocks)[:, None, None]


def paired_spectra(
    a: ArrayLike, b: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float
) -> NDArray[np.complex128]:
    """Return the cross-spectra of matching channels only: the diagonal of `cross_spectra`.

    Parameters
    ----------
    a
        Record `a`, shape (channels, samples).
    b
        Record `b`, shape (channels, samples), sampled at the same instants.
    block_samples
        Number of samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Complex, shape (lines, channels): ``E[A_i conj(B_i)]``, one-sided density. Real if `a` is `b`.

    Raises
    ------
    ValueError
        If the records do not agree, are shorter than a block, or a parameter is not allowed.
    """
    first, second = matching_records(a, b)
    if first.shape[0] != second.shape[0]:
        raise ValueError(
            f"The records have {first.shape[0]} and {second.shape[0]} channels; pairs need as many in both."
        )
    window, hop, blocks = _blocking(first.shape[1], block_samples, overlap, sample_rate)
    channels = first.shape[0]
    total = np.zeros((block_samples // 2 + 1, channels), dtype=np.complex128)
    for lines in BlockSpectra(window, hop=hop, channels=2 * channels).chunks(first, second):
        total += np.sum(lines[:, :channels] * lines[:, channels:].conj(), axis=2)
    return total * density_scale(window, sample_rate, blocks)[:, None]


def auto_spectra(a: ArrayLike, *, block_samples: int, overlap: float, sample_rate: float) -> NDArray[np.float64]:
    """Return the power spectral density of each channel by Welch's method: periodic Hann window, no detrending.

    Parameters
    ----------
    a
        Record, shape (channels, samples).
    block_samples
        Number of samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Real, shape (lines, channels), one-sided, the channel's unit squared per Hz.

    Raises
    ------
    ValueError
        If the record is shorter than a block or a parameter is not allowed.
    """
    record = as_record(a, name="a")
    window, hop, blocks = _blocking(record.shape[1], block_samples, overlap, sample_rate)
    spectra = BlockSpectra(window, hop=hop, channels=record.shape[0], powered=record.shape[0])
    for _ in spectra.chunks(record):
        pass
    return spectra.power * density_scale(window, sample_rate, blocks)[:, None]


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
