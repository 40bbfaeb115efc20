"""Errors of a response against its target, per channel and over all."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.records import as_record


def rms(samples: ArrayLike) -> NDArray[np.float64]:
    """Return the root mean square of each channel, its mean included.

    Parameters
    ----------
    samples
        Record, shape (channels, samples).

    Returns
    -------
    numpy.ndarray
        RMS values, shape (channels), each in its channel's unit.

    Raises
    ------
    ValueError
        If the record is not allowed.
    """
    record = as_record(samples)
    return np.sqrt(np.mean(record**2, axis=1))


def relative_rms_error(target: ArrayLike, response: ArrayLike) -> NDArray[np.float64]:
    """Return the relative RMS error of each channel, ``rms(y_d - y) / rms(y_d)``; 0 is perfect, 1 is no response.

    Parameters
    ----------
    target
        Target, shape (channels, samples); no channel zero throughout.
    response
        Response, shape (channels, samples).

    Returns
    -------
    numpy.ndarray
        Errors, shape (channels), 0 or more.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a target channel is zero throughout.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, section on the iteration's metrics.
    """
    wanted, measured = _comparable(target, response)
    return rms(wanted - measured) / _nonzero_rms(wanted)


def overall_relative_rms_error(target: ArrayLike, response: ArrayLike) -> float:
    """Return the relative RMS error over all channels, each scaled by its target's RMS.

    Parameters
    ----------
    target
        Target, shape (channels, samples); no channel zero throughout.
    response
        Response, shape (channels, samples).

    Returns
    -------
    float
        Root mean square over the channels of `relative_rms_error`, 0 or more.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a target channel is zero throughout.
    """
    return float(np.sqrt(np.mean(relative_rms_error(target, response) ** 2)))


def rms_response(target: ArrayLike, response: ArrayLike) -> NDArray[np.float64]:
    """Return the RMS of the response over that of the target, ``rms(y) / rms(y_d)``, per channel; the goal is 1.

    Parameters
    ----------
    target
        Target, shape (channels, samples); no channel zero throughout.
    response
        Response, shape (channels, samples).

    Returns
    -------
    numpy.ndarray
        Ratios, shape (channels), 0 or more.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a target channel is zero throughout.
    """
    wanted, measured = _comparable(target, response)
    return rms(measured) / _nonzero_rms(wanted)


def peak_ratio(target: ArrayLike, response: ArrayLike) -> NDArray[np.float64]:
    """Return the largest magnitude of the response over that of the target, per channel; the goal is 1.

    Parameters
    ----------
    target
        Target, shape (channels, samples); no channel zero throughout.
    response
        Response, shape (channels, samples).

    Returns
    -------
    numpy.ndarray
        Ratios, shape (channels), 0 or more.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a target channel is zero throughout.
    """
    wanted, measured = _comparable(target, response)
    _nonzero_rms(wanted)
    return np.max(np.abs(measured), axis=1) / np.max(np.abs(wanted), axis=1)


def crest_factor(samples: ArrayLike) -> NDArray[np.float64]:
    """Return the largest magnitude of each channel over its RMS, mean included: 1 for a square wave, √2 for a sine.

    Parameters
    ----------
    samples
        Record, shape (channels, samples); no channel zero throughout.

    Returns
    -------
    numpy.ndarray
        Crest factors, shape (channels), 1 or more.

    Raises
    ------
    ValueError
        If the record is not allowed or a channel is zero throughout.
    """
    record = as_record(samples)
    level = rms(record)
    silent = np.flatnonzero(level == 0.0)
    if silent.size:
        raise ValueError(f"Channel {silent[0]} is zero throughout and has no crest factor; leave it out.")
    return np.max(np.abs(record), axis=1) / level


def _comparable(target: ArrayLike, response: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    wanted, measured = as_record(target, name="target"), as_record(response, name="response")
    if wanted.shape != measured.shape:
        raise ValueError(
            f"The target has shape {wanted.shape} and the response {measured.shape}; they must be equal to be compared."
        )
    return wanted, measured


def _nonzero_rms(target: NDArray[np.float64]) -> NDArray[np.float64]:
    level = rms(target)
    silent = np.flatnonzero(level == 0.0)
    if silent.size:
        raise ValueError(
            f"Target channel {silent[0]} is zero throughout, so an error relative to it is undefined; "
            "leave it out or give a target that moves."
        )
    return level
