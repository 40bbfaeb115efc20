"""Conversion of arrays and records between numpy and the contract; input is checked, and elements are not copied."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import DTypeLike

from duralab_proto.v1 import array_pb2

_DTYPES: Final[dict[array_pb2.ElementType, np.dtype]] = {
    array_pb2.ELEMENT_TYPE_FLOAT64: np.dtype("<f8"),
    array_pb2.ELEMENT_TYPE_FLOAT32: np.dtype("<f4"),
    array_pb2.ELEMENT_TYPE_COMPLEX128: np.dtype("<c16"),
    array_pb2.ELEMENT_TYPE_INT64: np.dtype("<i8"),
}
_ELEMENT_TYPES: Final = {dtype: element_type for element_type, dtype in _DTYPES.items()}

LARGEST_RANK: Final = 8
"""Largest number of axes of an Array; the contract needs three, and numpy allows 64."""


class ArrayError(ValueError):
    """An Array or Record is not valid.

    Parameters
    ----------
    message : str
        One sentence: the wrong value, and what is allowed.
    field : str
        Path of the wrong field of the message, e.g. "drive.samples".
    """

    def __init__(self, message: str, *, field: str) -> None:
        super().__init__(message)
        self.field = field


def to_array(values: np.ndarray) -> array_pb2.Array:
    """Encode a numpy array.

    Parameters
    ----------
    values : np.ndarray
        float64, float32, complex128 or int64, any shape of at most `LARGEST_RANK` axes, any byte order or layout.

    Returns
    -------
    array_pb2.Array
        Array with the elements in C order, little-endian.

    Raises
    ------
    ArrayError
        The contract has no such element type, or `values` has too many axes.
    """
    message = array_pb2.Array()
    _fill(message, values)
    return message


def _fill(message: array_pb2.Array, values: np.ndarray) -> None:
    little_endian = values.dtype.newbyteorder("<")
    if little_endian not in _ELEMENT_TYPES:
        allowed = ", ".join(dtype.name for dtype in _DTYPES.values())
        raise ArrayError(f"An array of {values.dtype} cannot be sent; allowed are {allowed}.", field="array")
    if values.ndim > LARGEST_RANK:
        raise ArrayError(f"An array of {values.ndim} axes cannot be sent; allowed are {LARGEST_RANK}.", field="array")
    message.element_type = _ELEMENT_TYPES[little_endian]
    message.shape[:] = values.shape
    message.data = values.astype(little_endian, copy=False).tobytes(order="C")


def from_array(
    message: array_pb2.Array,
    *,
    field: str = "array",
    shape: Sequence[int | None] | None = None,
    dtype: DTypeLike | None = None,
    finite: bool = True,
) -> np.ndarray:
    """Decode an Array and check it.

    Parameters
    ----------
    message : array_pb2.Array
        Received message; nothing in it is trusted.
    field : str
        Path of the field that holds it, for the error.
    shape : sequence of int or None, optional
        Expected length of each axis; None for any length.
    dtype : dtype-like, optional
        Expected element type; any of the contract's if not given.
    finite : bool
        Whether to refuse NaN and infinities.

    Returns
    -------
    np.ndarray
        A read-only, C-contiguous view of the message's elements.

    Raises
    ------
    ArrayError
        Unknown element type, wrong type or shape, bytes that do not fit the shape, or a value that is not finite.
    """
    element_type = _DTYPES.get(message.element_type)
    if element_type is None:
        raise ArrayError(
            f"{field} has the unknown element type {message.element_type}; allowed are {sorted(_DTYPES)}.", field=field
        )
    if dtype is not None and element_type != np.dtype(dtype).newbyteorder("<"):
        raise ArrayError(
            f"{field} has elements of {element_type.name}; it must be {np.dtype(dtype).name}.", field=field
        )
    lengths = tuple(message.shape)
    if len(lengths) > LARGEST_RANK:
        raise ArrayError(f"{field} has {len(lengths)} axes; at most {LARGEST_RANK} are allowed.", field=field)
    if shape is not None:
        _check_shape(lengths, shape, field=field)
    data = message.data
    # Python integers do not overflow, so a hostile shape cannot wrap around to the length of the data.
    expected = math.prod(lengths) * element_type.itemsize
    if len(data) != expected:
        raise ArrayError(
            f"{field} has {len(data)} bytes; its shape {lengths} of {element_type.name} takes {expected}.", field=field
        )
    try:
        values = np.frombuffer(data, dtype=element_type).reshape(lengths)
    except ValueError as error:
        # An empty array passes the check above with axes of any length, also of one numpy cannot hold.
        raise ArrayError(f"{field} has the shape {lengths}, which is too large.", field=field) from error
    if finite and element_type.kind in "fc":
        _check_finite(values, field=field)
    return values


def _check_shape(lengths: tuple[int, ...], shape: Sequence[int | None], *, field: str) -> None:
    fits = len(lengths) == len(shape) and all(
        wanted in (None, length) for length, wanted in zip(lengths, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if length is None else str(length) for length in shape)
        raise ArrayError(f"{field} has the shape {lengths}; it must be ({wanted}).", field=field)


def _check_finite(values: np.ndarray, *, field: str) -> None:
    finite = np.isfinite(values)
    if not finite.all():
        index = tuple(int(i) for i in np.unravel_index(int(np.argmin(finite)), values.shape))
        raise ArrayError(f"{field} is {values[index]} at index {index}; every value must be finite.", field=field)


def to_record(
    channels: Iterable[array_pb2.Channel],
    sample_rate: float,
    samples: np.ndarray,
    *,
    into: array_pb2.Record | None = None,
) -> array_pb2.Record:
    """Encode sampled signals.

    Parameters
    ----------
    channels : iterable of array_pb2.Channel
        Channels, one for each row of `samples`.
    sample_rate : float
        Samples per second, in hertz, greater than 0.
    samples : np.ndarray, shape (channels, samples)
        Samples as float64, each row in its channel's unit.
    into : array_pb2.Record, optional
        Empty record in a larger message, to avoid the copy that the larger message's constructor would make.

    Returns
    -------
    array_pb2.Record
        Message for the bus.

    Raises
    ------
    ArrayError
        The parts do not fit together.
    """
    record = array_pb2.Record() if into is None else into
    record.channels.extend(channels)
    record.sample_rate = sample_rate
    _fill(record.samples, samples)
    _check_record(record, samples, field="record")
    return record


def from_record(
    record: array_pb2.Record, *, field: str = "record"
) -> tuple[list[array_pb2.Channel], float, np.ndarray]:
    """Decode sampled signals and check them.

    Parameters
    ----------
    record : array_pb2.Record
        Received message; nothing in it is trusted.
    field : str
        Path of the field that holds it, for the error.

    Returns
    -------
    channels : list of array_pb2.Channel
        Channels with distinct, non-empty names.
    sample_rate : float
        Sample rate in hertz, finite and greater than 0.
    samples : np.ndarray, shape (channels, samples)
        float64, finite, a read-only view; each row in its channel's unit.

    Raises
    ------
    ArrayError
        The record is not as described above.
    """
    samples = from_array(record.samples, field=f"{field}.samples", shape=(None, None), dtype=np.float64)
    _check_record(record, samples, field=field)
    return list(record.channels), record.sample_rate, samples


def _check_record(record: array_pb2.Record, samples: np.ndarray, *, field: str) -> None:
    if not (math.isfinite(record.sample_rate) and record.sample_rate > 0):
        raise ArrayError(
            f"{field}.sample_rate is {record.sample_rate} Hz; it must be greater than 0.", field=f"{field}.sample_rate"
        )
    if samples.ndim != 2 or samples.dtype != np.float64:
        raise ArrayError(
            f"{field}.samples has {samples.ndim} axes of {samples.dtype}; it must be (channels, samples) of float64.",
            field=f"{field}.samples",
        )
    names = [channel.name for channel in record.channels]
    if len(names) != samples.shape[0]:
        raise ArrayError(
            f"{field} has {len(names)} channels and {samples.shape[0]} rows of samples; each channel needs one row.",
            field=f"{field}.channels",
        )
    unusable = sorted({name for name in names if not name or names.count(name) > 1})
    if unusable:
        raise ArrayError(
            f"{field}.channels has the names {unusable} empty or more than once; each channel needs its own name.",
            field=f"{field}.channels",
        )


class SamplesHash:
    """SHA-256 of the samples of a run, independent of blocks: sample by sample, drives then responses."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def add(self, drive: np.ndarray, response: np.ndarray) -> None:
        """Add the next samples.

        Parameters
        ----------
        drive, response : np.ndarray, shape (channels, samples)
            float64, as many samples of each.
        """
        drives = drive.shape[0]
        rows = np.empty((drive.shape[1], drives + response.shape[0]), dtype="<f8")
        rows[:, :drives], rows[:, drives:] = drive.T, response.T
        self._digest.update(rows.data)

    def hexdigest(self) -> str:
        """Return the hash of the samples added so far, 64 hexadecimal digits."""
        return self._digest.hexdigest()


def samples_hash(drive: np.ndarray, response: np.ndarray) -> str:
    """Return the hash of the samples of a run, as stored in a step.

    Parameters
    ----------
    drive, response : np.ndarray, shape (channels, samples)
        float64, as many samples of each, in the units of the rig's description.

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits.
    """
    found = SamplesHash()
    found.add(drive, response)
    return found.hexdigest()
