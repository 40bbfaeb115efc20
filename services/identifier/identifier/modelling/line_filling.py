"""Interpolation of the lines that an odd multisine leaves out, and the valid band of a model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identifier.estimators import FrfEstimate
from identifier.layout import Layout
from identifier.uncertainty import ValidBand, row_covariance


@dataclass(frozen=True)
class FilledLines:
    """Estimate at every line of its band. All except `interpolated` are 0 outside it.

    `frf`: Complex, shape (lines, responses, drives). `coherence`: Shape (lines, responses). `condition_number`: Shape
    (lines). `residual_psd`: Shape (lines, responses). `row_covariance`: Complex, shape (lines, drives, drives), see the
    function of that name. `interpolated`: Shape (lines): linearly interpolated, not estimated.
    """

    frf: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    condition_number: NDArray[np.float64]
    residual_psd: NDArray[np.float64]
    row_covariance: NDArray[np.complex128]
    interpolated: NDArray[np.bool_]


def valid_band(layout: Layout) -> ValidBand:
    """Return the band in which the model of an experiment will be valid.

    `layout`: Layout of the experiment.
    Returns: Band from the lower to the upper edge of the excitation; if lines next to an edge are left out, from the
    first or to the last excited line.
    """
    excited = np.flatnonzero(layout.excited)
    in_band = np.flatnonzero((layout.frequency >= layout.lowest) & (layout.frequency <= layout.highest))
    return ValidBand(
        lowest=layout.lowest if excited[0] == in_band[0] else float(layout.frequency[excited[0]]),
        highest=layout.highest if excited[-1] == in_band[-1] else float(layout.frequency[excited[-1]]),
        sample_rate=layout.sample_rate,
        block_samples=layout.block_samples,
    )


def fill_lines(estimate: FrfEstimate) -> FilledLines:
    """Interpolate the lines between estimated ones.

    `estimate`: Valid at one line or more.
    Returns: The estimate itself if no lines are left out.
    """
    known = np.flatnonzero(estimate.valid)
    wanted = np.arange(known[0], known[-1] + 1)
    missing = wanted[~estimate.valid[wanted]]
    after = np.searchsorted(known, missing)
    below, above = known[after - 1], known[np.minimum(after, known.size - 1)]
    share = (missing - below) / np.maximum(above - below, 1)

    def filled(values: NDArray) -> NDArray:
        result = np.where(_column(estimate.valid, values), values, np.zeros((), dtype=values.dtype))
        weight = _column(share, values)
        result[missing] = (1.0 - weight) * values[below] + weight * values[above]
        return np.ascontiguousarray(result)

    interpolated = np.zeros(estimate.frequency.size, dtype=np.bool_)
    interpolated[missing] = True
    return FilledLines(
        frf=filled(estimate.frf),
        coherence=filled(estimate.coherence),
        condition_number=filled(estimate.condition_number),
        residual_psd=filled(estimate.residual_psd),
        row_covariance=filled(row_covariance(estimate.s_uu, averages=estimate.averages)),
        interpolated=interpolated,
    )


def _column(line_values: NDArray, values: NDArray) -> NDArray:
    return line_values.reshape(-1, *(1,) * (values.ndim - 1))
