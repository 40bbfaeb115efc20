"""Windows of a block."""

import numpy as np
from numpy.typing import NDArray


def hann_periodic(samples: int) -> NDArray[np.float64]:
    """Return the periodic Hann window, whose half-overlapped copies add up to a constant.

    Parameters
    ----------
    samples
        Length of the block, 2 or more.

    Returns
    -------
    numpy.ndarray
        Shape (samples): ``0.5 - 0.5 cos(2 pi n / samples)``, 0 at the first sample, 1 in the middle.

    Raises
    ------
    ValueError
        If the block is shorter than 2 samples.
    """
    if samples < 2:
        raise ValueError(f"A Hann window of {samples} samples was asked for; it needs 2 or more.")
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(samples) / samples)
