"""Linear fades, so that a rig at rest gets no shock."""

import numpy as np
from numpy.typing import NDArray


def linear_fades(samples: int, fade_samples: int) -> NDArray[np.float64]:
    """Return a weight that rises linearly from 0 at the start, is 1, and falls linearly to 0 at the end.

    Parameters
    ----------
    samples
        Length of the record.
    fade_samples
        Samples of each fade, 0 for none, at most half the record.

    Returns
    -------
    numpy.ndarray
        Weight, shape (samples), 0 to 1.
    """
    weight = np.ones(samples)
    if fade_samples > 0:
        rise = np.arange(fade_samples) / fade_samples
        weight[:fade_samples] = rise
        weight[samples - fade_samples :] = rise[::-1]
    return weight
