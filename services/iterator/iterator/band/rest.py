"""Fades of targets and drives, which begin and end at rest because a rig does."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

TARGET_FADE_SECONDS: Final = 0.25
"""Time in s in which a target rises from rest at its start, and returns to rest at its end."""
DRIVE_FADE_SECONDS: Final = 0.05
"""Fade of a drive in s: short compared with the target's, so that the fade causes no error to correct."""
# Largest share of a short record for each fade.
_LARGEST_SHARE: Final = 0.125


def faded(samples: NDArray[np.float64], *, sample_rate: float, seconds: float) -> NDArray[np.float64]:
    """Return a record that rises from 0 at its first sample and falls to 0 at its last one.

    `samples`, shape (channels, samples): Relative to rest, in any unit. `sample_rate`: Hz, greater than 0. `seconds`:
    Duration of each fade, 0 or more; an eighth of the record at most. The fade is a squared sine.
    Returns: Copy of the record, shape (channels, samples).
    """
    count = samples.shape[1]
    result = samples.copy()
    length = min(round(seconds * sample_rate), int(_LARGEST_SHARE * count))
    if length > 0:
        weight = np.sin(0.5 * np.pi * np.arange(length) / length) ** 2
        result[:, :length] *= weight
        result[:, count - length :] *= weight[::-1]
    return result
