"""How well one playback reproduced the target, in the control band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spectra import overall_relative_rms_error, peak_ratio, relative_rms_error, rms_response


@dataclass(frozen=True)
class IterationMetrics:
    """Figures of one playback; arrays have one value for each response.

    Parameters
    ----------
    relative_rms_error : ndarray, shape (n_y,)
        `rms(y_d - y) / rms(y_d)`, towards 0.
    rms_response : ndarray, shape (n_y,)
        `rms(y) / rms(y_d)`, towards 1.
    peak_ratio : ndarray, shape (n_y,)
        Largest magnitude of the response over that of the target, towards 1.
    overall_relative_rms_error : float
        Root mean square of `relative_rms_error` over the responses.
    """

    relative_rms_error: NDArray[np.float64]
    rms_response: NDArray[np.float64]
    peak_ratio: NDArray[np.float64]
    overall_relative_rms_error: float


def judge_response(target: NDArray[np.float64], response: NDArray[np.float64]) -> IterationMetrics:
    """Compare a response with the target.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        Both in the control band, response units; no channel of the target zero throughout.

    Returns
    -------
    IterationMetrics
        Of this playback.

    Raises
    ------
    ValueError
        Shapes that differ, values that are not finite, or a silent target channel.
    """
    return IterationMetrics(
        relative_rms_error=relative_rms_error(target, response),
        rms_response=rms_response(target, response),
        peak_ratio=peak_ratio(target, response),
        overall_relative_rms_error=overall_relative_rms_error(target, response),
    )


def best_iteration(metrics: tuple[IterationMetrics, ...]) -> int:
    """Return the number of the playback with the smallest error over all channels.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        From the first playback to the last.

    Returns
    -------
    int
        From 1; 0 where there is none.
    """
    if not metrics:
        return 0
    return 1 + int(np.argmin([figures.overall_relative_rms_error for figures in metrics]))
