"""Load cycles of a signal by rainflow counting, and the pseudo-damage that they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record

DAMAGE_EXPONENTS: Final = (3.0, 5.0, 8.0)
"""Slopes of the S-N lines for pseudo-damage: from welded joints (3) to smooth parts (8)."""


@dataclass(frozen=True)
class LoadCycles:
    """Cycles of one signal, one value each, in no particular order.

    Parameters
    ----------
    ranges : ndarray, shape (cycles,)
        Range from valley to peak (not the amplitude, which is half of it), in the signal's unit, greater than 0.
    means : ndarray, shape (cycles,)
        Mean of valley and peak, in the signal's unit.
    counts : ndarray, shape (cycles,)
        Weight: 1 for a closed cycle, 0.5 for one that the signal left open.
    starts, ends : ndarray, shape (cycles,)
        Sample numbers, from 0, of the turning points at both ends of a cycle.
    """

    ranges: NDArray[np.float64]
    means: NDArray[np.float64]
    counts: NDArray[np.float64]
    starts: NDArray[np.intp]
    ends: NDArray[np.intp]


def as_signal(signal: ArrayLike) -> NDArray[np.float64]:
    """Check one channel's signal and return it as float64."""
    values = np.asarray(signal)
    if values.ndim != 1:
        raise ValueError(f"signal has shape {values.shape}; a signal has shape (samples,): give one channel at a time.")
    return as_record(values[np.newaxis], name="signal")[0]


def count_load_cycles(signal: ArrayLike) -> LoadCycles:
    """Count the cycles of a signal.

    The residual is counted as half cycles: without it, the largest ranges would be missing.

    Parameters
    ----------
    signal : array_like, shape (samples,)
        Finite signal.

    Returns
    -------
    LoadCycles
        Cycles; empty for a constant signal.

    Raises
    ------
    ValueError
        If there is no signal, several channels, or a value that is not finite.

    Notes
    -----
    Source: ASTM E1049-85, section 5.4.4, rainflow counting. Four-point counting with the residual as half cycles gives
    the same cycles.
    """
    # pylife imports pandas, which takes a second: only callers that count cycles wait for it.
    from pylife.stress.rainflow import FourPointDetector, FullRecorder

    values = as_signal(signal)
    recorder = FullRecorder()
    detector = FourPointDetector(recorder=recorder).process(values)
    residual = np.asarray(detector.residuals, dtype=np.float64)
    start = np.concatenate([np.asarray(recorder.values_from, dtype=np.float64), residual[:-1]])
    end = np.concatenate([np.asarray(recorder.values_to, dtype=np.float64), residual[1:]])
    places = np.asarray(detector.residual_index, dtype=np.intp)
    starts = np.concatenate([np.asarray(recorder.index_from, dtype=np.intp), places[:-1]])
    ends = np.concatenate([np.asarray(recorder.index_to, dtype=np.intp), places[1:]])
    counts = np.ones(start.size)
    counts[start.size - residual[1:].size :] = 0.5
    ranges = np.abs(end - start)
    # A signal that ends on a turning point or is constant has that value twice in its residual.
    moved = ranges > 0.0
    return LoadCycles(
        ranges=ranges[moved],
        means=0.5 * (start + end)[moved],
        counts=counts[moved],
        starts=starts[moved],
        ends=ends[moved],
    )


def pseudo_damage(cycles: LoadCycles, exponent: float) -> float:
    """Return the sum of the cycles' ranges to the power of the S-N line's slope: damage without the material's factor.

    Parameters
    ----------
    cycles : LoadCycles
        Cycles of one signal.
    exponent : float
        Slope k of the S-N line, greater than 0.

    Returns
    -------
    float
        Pseudo-damage in the signal's unit to the power k; doubling the signal makes it `2^k` as large.

    Raises
    ------
    ValueError
        If the exponent is not greater than 0.

    Notes
    -----
    Source: Palmgren (1924), Miner, "Cumulative damage in fatigue" (1945): linear accumulation; Basquin's S-N line.
    """
    if not (np.isfinite(exponent) and exponent > 0.0):
        raise ValueError(f"The exponent of the S-N line is {exponent:g}; it must be finite and greater than 0.")
    return float(np.sum(cycles.counts * cycles.ranges**exponent))


def channel_damage(record: ArrayLike, *, exponents: Sequence[float] = DAMAGE_EXPONENTS) -> NDArray[np.float64]:
    """Return the pseudo-damage of each channel of a record.

    Parameters
    ----------
    record : array_like, shape (channels, samples)
        Record; static parts do not count.
    exponents : sequence of float
        Slopes of the S-N line, each greater than 0.

    Returns
    -------
    ndarray, shape (channels, exponents)
        Pseudo-damage in the channel's unit to the power of each exponent, 0 or more; 0 for a constant channel.

    Raises
    ------
    ValueError
        If a value is not finite, or an exponent is not greater than 0.
    """
    cycles = [count_load_cycles(signal) for signal in as_record(record, name="record")]
    return np.array([[pseudo_damage(counted, exponent) for exponent in exponents] for counted in cycles])


def damage_ratio(
    target: ArrayLike, response: ArrayLike, *, exponents: Sequence[float] = DAMAGE_EXPONENTS
) -> NDArray[np.float64]:
    """Return the pseudo-damage of each response over that of its target.

    Parameters
    ----------
    target, response : array_like, shape (channels, samples)
        Records in the same units, of any lengths; their static parts do not count.
    exponents : sequence of float
        Slopes of the S-N line, each greater than 0.

    Returns
    -------
    ndarray, shape (channels, exponents)
        Damage ratios, 0 or more; 1 is the damage of the target.

    Raises
    ------
    ValueError
        If the numbers of channels differ, a value is not finite, or a target channel is constant.
    """
    wanted, measured = as_record(target, name="target"), as_record(response, name="response")
    if wanted.shape[0] != measured.shape[0]:
        raise ValueError(
            f"The target has {wanted.shape[0]} channels and the response {measured.shape[0]}; both need as many."
        )
    ratio = np.empty((wanted.shape[0], len(exponents)))
    for i in range(wanted.shape[0]):
        # Both in units of the target's range: the eighth power of a force in newtons is too large to sum.
        unit = float(np.ptp(wanted[i]))
        if unit == 0.0:
            raise ValueError(
                f"Target channel {i} does not move, so a damage relative to it is undefined; leave it out."
            )
        done, intended = (
            channel_damage(signal[i : i + 1] / unit, exponents=exponents) for signal in (measured, wanted)
        )
        ratio[i] = done[0] / intended[0]
    return ratio
