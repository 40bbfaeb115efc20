"""Layout of a record: channels first, time along the last axis, float64, finite."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def as_record(samples: ArrayLike, *, name: str = "samples") -> NDArray[np.float64]:
    """Check a record and return it as float64, each channel without gaps in memory.

    Parameters
    ----------
    samples
        Record, shape (channels, samples), each row in its channel's unit; finite, not empty.
    name
        Name of the record in an error.

    Returns
    -------
    numpy.ndarray
        Record, shape (channels, samples); the same memory if no conversion was needed.

    Raises
    ------
    ValueError
        If the shape is not (channels, samples), a value is masked or not finite or a number is not real.
    """
    record = shaped_record(samples, name=name)
    _require_finite(record, name)
    return record


def shaped_record(samples: ArrayLike, *, name: str = "samples") -> NDArray[np.float64]:
    """Check the shape of a record and return it as `as_record` does; its values are not checked.

    Parameters
    ----------
    samples
        Record, shape (channels, samples), not empty.
    name
        Name of the record in an error.

    Returns
    -------
    numpy.ndarray
        Record, shape (channels, samples); the same memory if no conversion was needed.

    Raises
    ------
    ValueError
        If the shape is not (channels, samples), a value is masked or a number is not real.
    """
    # numpy drops a mask, and masked values are no measurements.
    if np.ma.is_masked(samples):
        raise ValueError(f"{name} has {np.ma.count_masked(samples)} masked values; fill them in or leave them out.")
    array = np.asarray(samples)
    if array.ndim != 2 or array.shape[0] < 1 or array.shape[1] < 1:
        raise ValueError(
            f"{name} has shape {array.shape}; a record has shape (channels, samples) with at least one of each."
        )
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds elements of type {array.dtype}; a record holds real numbers.")
    record = array.astype(np.float64, copy=False)
    if record.strides[1] != record.itemsize:
        record = np.ascontiguousarray(record)
    return record


def _require_finite(record: NDArray[np.float64], name: str) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        squares = [float(np.dot(channel, channel)) for channel in record]
    # One pass at the speed of memory. A square that is not finite may be that of a finite value beyond 1e154.
    for channel in np.flatnonzero(~np.isfinite(squares)):
        wrong = np.flatnonzero(~np.isfinite(record[channel]))
        if wrong.size:
            raise ValueError(
                f"{name} holds {record[channel, wrong[0]]} in channel {channel} at sample {wrong[0]}; "
                "every value of a record must be finite."
            )


def matching_records(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Check two records that were sampled together."""
    return _of_one_length(as_record(a, name="a"), as_record(b, name="b"))


def matching_shapes(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Check the shapes of two records that were sampled together; their values are not checked."""
    return _of_one_length(shaped_record(a, name="a"), shaped_record(b, name="b"))


def _of_one_length(
    first: NDArray[np.float64], second: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if first.shape[1] != second.shape[1]:
        raise ValueError(f"The records have {first.shape[1]} and {second.shape[1]} samples; both need as many.")
    return first, second


def require_sample_rate(sample_rate: float) -> None:
    """Refuse a sample rate that is not a positive, finite number of hertz.

    Parameters
    ----------
    sample_rate
        Sample rate in hertz, greater than 0.

    Raises
    ------
    ValueError
        If it is not.
    """
    if not (np.isfinite(sample_rate) and sample_rate > 0.0):
        raise ValueError(f"The sample rate is {sample_rate} Hz; it must be finite and greater than 0.")
