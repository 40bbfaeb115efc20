"""Application of an FRF matrix to a long record: acausal, zero-padded, without wrap-around, of the same length.

An FRF on the lines of a block has an impulse response of one block. It is centred: half of it is before time zero,
because the inverse of a rig is acausal. Both functions compute the same linear convolution.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.inverse import as_frf
from duralab_spectra.records import as_record
from duralab_spectra.transforms import backward, fast_length, forward

_CHUNK_BLOCKS = 8
_SMALLEST_TRANSFORM = 8192


def centred_impulse_response(frf: ArrayLike) -> NDArray[np.float64]:
    """Return the impulse response of an FRF, with time zero in the middle.

    Parameters
    ----------
    frf
        Complex, shape (lines, n_out, n_in), of a block of ``2 (lines - 1)`` samples. Imaginary parts at frequency 0 and
        at half the sample rate have no meaning for real signals and are not used.

    Returns
    -------
    numpy.ndarray
        Shape (n_out, n_in, block samples + 1), from minus half a block to plus half a block. The sample half a block
        away is part of both ends and is shared between them, so that a real FRF has no phase.

    Raises
    ------
    ValueError
        If the FRF's shape is wrong or a value is not finite.
    """
    matrix = as_frf(frf)
    block = 2 * (matrix.shape[0] - 1)
    half = block // 2
    periodic = backward(np.ascontiguousarray(matrix.transpose(1, 2, 0)), block)
    response = np.empty((*periodic.shape[:2], block + 1))
    response[..., half:block] = periodic[..., :half]
    response[..., :half] = periodic[..., half:]
    response[..., 0] *= 0.5
    response[..., block] = response[..., 0]
    return response


def filter_whole_record(samples: ArrayLike, frf: ArrayLike) -> NDArray[np.float64]:
    """Apply an FRF to a record in one transform, zero-padded by the length of the impulse response.

    Parameters
    ----------
    samples
        Record, shape (n_in, samples), of any length, also odd; taken as zero outside.
    frf
        Complex, shape (lines, n_out, n_in), masked to its band.

    Returns
    -------
    numpy.ndarray
        Filtered record, shape (n_out, samples). Needs memory for several spectra of the record; `overlap_save` does
        not.

    Raises
    ------
    ValueError
        If the shapes do not agree or a value is not finite.
    """
    record, matrix = _agreeing(samples, frf)
    count = record.shape[1]
    padded = fast_length(count + 2 * (matrix.shape[0] - 1))
    gain = _spectrum_of(centred_impulse_response(matrix), padded)
    spectrum = np.ascontiguousarray(forward(record, padded).T)
    product = np.matmul(gain, spectrum[:, :, None])[:, :, 0]
    return np.ascontiguousarray(backward(np.ascontiguousarray(product.T), padded)[:, :count])


def overlap_save(samples: ArrayLike, frf: ArrayLike, *, transform_samples: int | None = None) -> NDArray[np.float64]:
    """Apply an FRF to a record block by block (overlap-save): the same as `filter_whole_record`, in bounded memory.

    Parameters
    ----------
    samples
        Record, shape (n_in, samples), of any length, also odd; taken as zero outside.
    frf
        Complex, shape (lines, n_out, n_in), masked to its band; its block has ``2 (lines - 1)`` samples.
    transform_samples
        Length of each transform, even, longer than the FRF's block; if omitted, 8192 or four blocks, whichever is
        longer.

    Returns
    -------
    numpy.ndarray
        Filtered record, shape (n_out, samples).

    Raises
    ------
    ValueError
        If the shapes do not agree, a value is not finite, or the transform is too short.

    Notes
    -----
    Source: T. G. Stockham, "High-speed convolution and correlation" (1966).
    """
    record, matrix = _agreeing(samples, frf)
    block = 2 * (matrix.shape[0] - 1)
    length = max(_SMALLEST_TRANSFORM, fast_length(4 * block)) if transform_samples is None else transform_samples
    if length <= block or length % 2 != 0:
        raise ValueError(
            f"The transform has {length} samples; it must be even and longer than the FRF's block of {block} samples."
        )
    gain = _spectrum_of(centred_impulse_response(matrix), length)
    count, half, hop = record.shape[1], block // 2, length - block
    blocks = -(-count // hop)
    # Half a block of the past before each piece and half a block of its future after it.
    extended = np.zeros((record.shape[0], blocks * hop + block))
    extended[:, half : half + count] = record
    frames = np.lib.stride_tricks.sliding_window_view(extended, length, axis=1)[:, ::hop]
    result = np.empty((matrix.shape[1], blocks, hop))
    for start in range(0, blocks, _CHUNK_BLOCKS):
        spectrum = forward(frames[:, start : start + _CHUNK_BLOCKS])
        product = np.matmul(gain, np.ascontiguousarray(spectrum.transpose(2, 0, 1)))
        filtered = backward(np.ascontiguousarray(product.transpose(1, 2, 0)), length)
        # The ends of each transform wrap around; the middle is the linear convolution.
        result[:, start : start + _CHUNK_BLOCKS] = filtered[:, :, half : half + hop]
    return np.ascontiguousarray(result.reshape(matrix.shape[1], blocks * hop)[:, :count])


def _agreeing(samples: ArrayLike, frf: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    record, matrix = as_record(samples), as_frf(frf)
    if record.shape[0] != matrix.shape[2]:
        raise ValueError(
            f"The record has {record.shape[0]} channels and the FRF takes {matrix.shape[2]}; both must be equal."
        )
    return record, matrix


def _spectrum_of(impulse_response: NDArray[np.float64], samples: int) -> NDArray[np.complex128]:
    """Return the lines of a centred impulse response on a longer block, time zero at the block's first sample."""
    taps = impulse_response.shape[-1]
    half = taps // 2
    circular = np.zeros((*impulse_response.shape[:2], samples))
    circular[..., : half + 1] = impulse_response[..., half:]
    circular[..., samples - half :] = impulse_response[..., :half]
    return np.ascontiguousarray(forward(circular).transpose(2, 0, 1))
