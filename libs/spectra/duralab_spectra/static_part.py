"""Static part of a record, outside the band: the straight line from its level at the start to that at its end."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra.records import as_record, require_sample_rate

# Number of periods of the band's lower edge over which the level at an end is averaged, against sensor noise.
_END_PERIODS: Final = 0.05


def static_levels(samples: ArrayLike, *, lowest: float, sample_rate: float) -> NDArray[np.float64]:
    """Return the levels at start and end of a record, which define its static part.

    Parameters
    ----------
    samples
        Record, shape (channels, samples).
    lowest
        Lower edge of the band, in hertz, greater than 0.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Levels, shape (channels, 2), in the record's units.

    Raises
    ------
    ValueError
        If the samples are not a record, or the edge or the sample rate is not greater than 0.
    """
    values = as_record(samples)
    require_sample_rate(sample_rate)
    if not lowest > 0.0:
        raise ValueError(
            f"The band begins at {lowest} Hz; a static part is defined only for a band that begins above 0."
        )
    count = values.shape[1]
    ends = min(count, max(1, round(_END_PERIODS * sample_rate / lowest)))
    parts = slice(0, ends), slice(count - ends, count)
    return np.stack([values[:, part].mean(axis=1) for part in parts], axis=1)


def dynamic_part(samples: ArrayLike, *, lowest: float, sample_rate: float) -> NDArray[np.float64]:
    """Return a record without its static part, not limited to the band.

    The band holds no static part, but a step from a level to the zeros around the record, or from its end to its start,
    would ring into the band. Removing the mean would not prevent that: a damper moves the mean of a rough ride away
    from the rest around it, and a drift leaves as much at both ends.

    Parameters
    ----------
    samples
        Record, shape (channels, samples); the static part is between its levels at start and end.
    lowest
        Lower edge of the band, in hertz, greater than 0.
    sample_rate
        Sample rate in hertz, greater than 0.

    Returns
    -------
    numpy.ndarray
        Dynamic part, shape (channels, samples), in the record's units.

    Raises
    ------
    ValueError
        If the samples are not a record, or the edge or the sample rate is not greater than 0.
    """
    values = as_record(samples)
    start, end = static_levels(values, lowest=lowest, sample_rate=sample_rate).T
    return values - np.linspace(start, end, values.shape[1], axis=1)
