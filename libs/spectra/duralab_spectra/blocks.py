"""Division of a record into overlapping blocks, and the number of independent ones."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def hop_samples(block_samples: int, overlap: float) -> int:
    """Return the distance between the first samples of neighbouring blocks.

    Parameters
    ----------
    block_samples
        Number of samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1. The hop is the whole number of samples
        nearest to ``block_samples (1 - overlap)``.

    Returns
    -------
    int
        Hop in samples, 1 or more.

    Raises
    ------
    ValueError
        If the block is odd or too short, or the overlap leaves no hop.
    """
    if block_samples < 2 or block_samples % 2 != 0:
        raise ValueError(f"The block has {block_samples} samples; it must be an even number, 2 or more.")
    if not 0.0 <= overlap < 1.0:
        raise ValueError(f"The overlap is {overlap}; it must be 0 or more and less than 1.")
    hop = round(block_samples * (1.0 - overlap))
    if hop < 1:
        raise ValueError(
            f"An overlap of {overlap} moves blocks of {block_samples} samples by less than one sample; "
            f"it must be at most {1.0 - 1.0 / block_samples:.6g}."
        )
    return hop


def count_blocks(samples: int, block_samples: int, overlap: float) -> int:
    """Return the number of blocks in a record (Eq. 10 of the paper), with the overlap in whole samples.

    Parameters
    ----------
    samples
        Length of the record, 0 or more.
    block_samples
        Number of samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.

    Returns
    -------
    int
        ``floor((T - T_b) / (T_b (1 - r))) + 1``, or 0 if the record is shorter than a block.

    Raises
    ------
    ValueError
        If the block or the overlap is not allowed.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 10.
    """
    hop = hop_samples(block_samples, overlap)
    if samples < block_samples:
        return 0
    return (samples - block_samples) // hop + 1


def independent_averages(window: ArrayLike, hop: int, blocks: int) -> float:
    """Return the equivalent number of independent blocks, which accounts for the overlap and the window.

    Parameters
    ----------
    window
        Window, shape (block samples).
    hop
        Number of samples between the starts of neighbouring blocks, 1 or more.
    blocks
        Number of averaged blocks, 1 or more.

    Returns
    -------
    float
        ``K / (1 + 2 sum_j (1 - j/K) rho_j)``, ``rho_j = (sum_n w_n w_{n + j hop} / sum_n w_n^2)^2``; between 1 and
        `blocks`.

    Raises
    ------
    ValueError
        If the hop or the number of blocks is below 1, or the window is all zero.

    Notes
    -----
    Source: P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Trans. Audio
    Electroacoust. 15 (1967), for a spectrum that is smooth over the window's line width.
    """
    weights: NDArray[np.float64] = np.asarray(window, dtype=np.float64)
    energy = float(weights @ weights)
    if hop < 1 or blocks < 1:
        raise ValueError(f"The hop is {hop} and the number of blocks {blocks}; both must be 1 or more.")
    if energy <= 0.0:
        raise ValueError("The window is zero everywhere; it must hold some energy.")
    excess = 0.0
    for distance in range(1, blocks):
        shift = distance * hop
        if shift >= weights.size:
            break
        correlation = float(weights[:-shift] @ weights[shift:]) / energy
        excess += (1.0 - distance / blocks) * correlation**2
    return blocks / (1.0 + 2.0 * excess)
