"""Load cycles of a signal by rainflow counting, and the pseudo-damage that they do."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record


def _pylifes_loop() -> Callable[
    [NDArray[np.float64], NDArray[np.uintp]],
    tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uintp], NDArray[np.uintp], NDArray[np.uintp]],
]:
    """Return pylife's compiled four-point loop, loaded without pylife's package.

    The package imports pandas: 0.5 s of a processor in every process that counts cycles.
    """
    name = "pylife.rainflow_ext"
    module = sys.modules.get(name)
    if module is None:
        package = find_spec("pylife")
        spec = PathFinder.find_spec(name, package.submodule_search_locations) if package is not None else None
        if spec is None or spec.loader is None:
            raise ImportError(f"Load cycles are counted by {name}, which is not installed; install pylife.", name=name)
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        # For a program that also imports pylife: an extension is loaded once.
        sys.modules[name] = module
    return module.fourpoint_loop


# Loaded with this module, under its import's lock: two threads that count at once must not load it twice.
_four_point_loop: Final = _pylifes_loop()

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
    values = as_signal(signal)
    places = _turning_points(values)
    from_values, to_values, from_places, to_places, left = _four_point_loop(values[places], places)
    residual = places[left]
    start = np.concatenate([from_values, values[residual[:-1]]])
    end = np.concatenate([to_values, values[residual[1:]]])
    starts = np.concatenate([from_places, residual[:-1]]).astype(np.intp)
    ends = np.concatenate([to_places, residual[1:]]).astype(np.intp)
    counts = np.ones(start.size)
    counts[len(from_values) :] = 0.5
    ranges = np.abs(end - start)
    # The last sample of a signal that ends on a plateau, or is constant, has the value of the turning point before it.
    moved = ranges > 0.0
    return LoadCycles(
        ranges=ranges[moved],
        means=0.5 * (start + end)[moved],
        counts=counts[moved],
        starts=starts[moved],
        ends=ends[moved],
    )


def _turning_points(values: NDArray[np.float64]) -> NDArray[np.uintp]:
    """Return the sample numbers of all turning points, of a plateau its first; the first and last sample are two."""
    plateaus = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    rising = np.diff(values[plateaus]) > 0.0
    turns = plateaus[1:-1][rising[1:] != rising[:-1]]
    return np.concatenate([[0], turns, [len(values) - 1]]).astype(np.uintp)


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
