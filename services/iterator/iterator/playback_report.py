"""Everything that a durability report shows of one playback: figures in band and overall, spectra, level crossings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iterator.control_band import ControlBand
from iterator.iteration_metrics import IterationMetrics, judge_response
from spectra import as_record, auto_spectra, count_level_crossings, line_frequencies, paired_spectra


@dataclass(frozen=True)
class SpectrumOverlay:
    """Power spectral densities of target and response, to be drawn over each other.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Hz.
    target, response, error : ndarray, shape (lines, n_y)
        Response unit squared per Hz.
    coherence : ndarray, shape (lines, n_y)
        Of response with target, 0 to 1; 0 at lines where either has no energy.
    """

    frequency: NDArray[np.float64]
    target: NDArray[np.float64]
    response: NDArray[np.float64]
    error: NDArray[np.float64]
    coherence: NDArray[np.float64]


@dataclass(frozen=True)
class PlaybackReport:
    """One playback against its target.

    Parameters
    ----------
    in_band : IterationMetrics
        Dynamic parts in the control band: what the iteration is judged by.
    overall : IterationMetrics
        Dynamic parts at all frequencies: what the specimen feels.
    spectra : SpectrumOverlay
        Of the dynamic parts at all frequencies.
    levels : ndarray, shape (n_y, levels)
        Of each channel, in equal steps between the target's smallest and largest value, response units.
    target_crossings, response_crossings : ndarray of int, shape (n_y, levels)
        How often each rises through each level, at all frequencies.
    """

    in_band: IterationMetrics
    overall: IterationMetrics
    spectra: SpectrumOverlay
    levels: NDArray[np.float64]
    target_crossings: NDArray[np.int64]
    response_crossings: NDArray[np.int64]


def report_playback(
    target: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    band: ControlBand,
    block_samples: int,
    levels: int = 32,
) -> PlaybackReport:
    """Compare a response with its target as a durability report does.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        As measured; their static parts are left out. No channel of the target at rest.
    band : ControlBand
        Of the campaign.
    block_samples : int
        Of the spectra, even, 2 or more and at most as long as the records; half of each block overlaps the next.
    levels : int
        How many levels, 2 or more.

    Returns
    -------
    PlaybackReport
        Figures, spectra and level crossings.

    Raises
    ------
    ValueError
        Shapes that differ, values that are not finite, a target channel at rest, or a parameter that is not allowed.
    """
    if levels < 2:
        raise ValueError(f"Crossings of {levels} levels were asked for; it must be 2 or more.")
    wanted, measured = band.dynamic_part(target), band.dynamic_part(response)
    overall = judge_response(wanted, measured)
    steps = np.linspace(wanted.min(axis=1), wanted.max(axis=1), levels + 2, axis=1)[:, 1:-1]
    crossings = [
        np.concatenate([count_level_crossings(signal[i : i + 1], steps[i]) for i in range(wanted.shape[0])])
        for signal in (wanted, measured)
    ]
    return PlaybackReport(
        in_band=judge_response(band.limit_target(target), band.limit_response(response)),
        overall=overall,
        spectra=overlay_spectra(wanted, measured, sample_rate=band.sample_rate, block_samples=block_samples),
        levels=steps,
        target_crossings=crossings[0],
        response_crossings=crossings[1],
    )


def overlay_spectra(
    target: NDArray[np.float64], response: NDArray[np.float64], *, sample_rate: float, block_samples: int
) -> SpectrumOverlay:
    """Estimate the spectra of a target, a response and what they differ by.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        In the same units.
    sample_rate : float
        Hz.
    block_samples : int
        Even, 2 or more; half of each block overlaps the next.

    Returns
    -------
    SpectrumOverlay
        Welch estimates.

    Raises
    ------
    ValueError
        Shapes that differ, values that are not finite, or records shorter than a block.
    """
    wanted, measured = as_record(target, name="target"), as_record(response, name="response")
    psd, power, error = (
        auto_spectra(signal, block_samples=block_samples, overlap=0.5, sample_rate=sample_rate)
        for signal in (wanted, measured, wanted - measured)
    )
    cross = paired_spectra(measured, wanted, block_samples=block_samples, overlap=0.5, sample_rate=sample_rate)
    product = psd * power
    coherence = np.divide(np.abs(cross) ** 2, product, out=np.zeros_like(product), where=product > 0.0)
    return SpectrumOverlay(
        frequency=line_frequencies(block_samples, sample_rate),
        target=psd,
        response=power,
        error=error,
        # Rounding alone takes a coherence of 1 past it.
        coherence=np.minimum(coherence, 1.0),
    )
