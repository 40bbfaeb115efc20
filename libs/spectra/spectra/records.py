"""What a record is: channels first, time along the last axis, float64, finite."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def as_record(samples: ArrayLike, *, name: str = "samples") -> NDArray[np.float64]:
    """Check a record and return it as C-contiguous float64.

    Parameters
    ----------
    samples
        Shape (channels, samples), each row in its channel's unit; finite, not empty.
    name
        What the record is called in an error.

    Returns
    -------
    numpy.ndarray
        Shape (channels, samples); the same memory where nothing had to be converted.

    Raises
    ------
    ValueError
        Where the shape is not (channels, samples), a value is not finite or a number is not real.
    """
    array = np.asarray(samples)
    if array.ndim != 2 or array.shape[0] < 1 or array.shape[1] < 1:
        raise ValueError(
            f"{name} has shape {array.shape}; a record has shape (channels, samples) with at least one of each."
        )
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds elements of type {array.dtype}; a record holds real numbers.")
    record = np.ascontiguousarray(array, dtype=np.float64)
    finite = np.isfinite(record)
    if not finite.all():
        channel, sample = np.argwhere(~finite)[0]
        raise ValueError(
            f"{name} holds {record[channel, sample]} in channel {channel} at sample {sample}; "
            "every value of a record must be finite."
        )
    return record


def require_sample_rate(sample_rate: float) -> None:
    """Refuse a sample rate that is not a positive, finite number of hertz.

    Parameters
    ----------
    sample_rate
        In hertz, greater than 0.

    Raises
    ------
    ValueError
        Where it is not.
    """
    if not (np.isfinite(sample_rate) and sample_rate > 0.0):
        raise ValueError(f"The sample rate is {sample_rate} Hz; it must be finite and greater than 0.")
