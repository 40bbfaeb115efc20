"""Noise floor from the differences of repeats of one playback."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.records import as_record


def noise_floor(repeats: Sequence[ArrayLike]) -> NDArray[np.float64]:
    """Return the RMS of the noise in each channel, from responses to the same drive.

    Parameters
    ----------
    repeats
        Two or more records of shape (channels, samples), of the same drive, sampled from the same instant.

    Returns
    -------
    numpy.ndarray
        Noise, shape (channels), 0 or more, each in its channel's unit: the expected RMS of the difference of one record
        from the mean of infinitely many. Over the target's RMS it is the smallest relative RMS error that a drive can
        reach.

    Raises
    ------
    ValueError
        If there are fewer than two repeats, their shapes differ, or a value is not finite.

    Notes
    -----
    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, sample variance over periods.
    """
    if len(repeats) < 2:
        raise ValueError(f"There are {len(repeats)} repeats; a noise floor needs two or more of the same drive.")
    records = [as_record(repeat, name=f"repeat {number}") for number, repeat in enumerate(repeats, start=1)]
    shapes = {record.shape for record in records}
    if len(shapes) > 1:
        raise ValueError(f"The repeats have the shapes {sorted(shapes)}; they must be equal.")
    return np.sqrt(np.mean(np.var(np.stack(records), axis=0, ddof=1), axis=1))
