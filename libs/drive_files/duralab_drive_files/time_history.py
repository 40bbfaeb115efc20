"""Sampled signals with names and units, as in a controller's file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class TimeHistory:
    """Signals of several channels at one sample rate.

    Parameters
    ----------
    names, units : tuple of str
        Name and unit of each row of `samples`.
    sample_rate : float
        Sample rate in hertz, greater than 0.
    samples : ndarray, shape (channels, samples)
        Samples as float64, each row in its channel's unit.
    attributes : mapping of str to str
        Further content of the file.
    labels : tuple of str
        Names as in the file, not necessarily unique; empty if they are `names`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    sample_rate: float
    samples: np.ndarray
    attributes: Mapping[str, str] = field(default_factory=dict)
    labels: tuple[str, ...] = ()


def unique_names(names: Iterable[str]) -> list[str]:
    """Return the names without repetitions, in order.

    Parameters
    ----------
    names : iterable of str
        Names as in a file.

    Returns
    -------
    list of str
        Names. An empty one becomes "channel_<place>", from 1; a repeated one gets the first of "_2", "_3" and so on
        that makes a name of no other channel.
    """
    given = [name.strip() for name in names]
    # No made name may be the name that the file gives to another channel.
    reserved = set(given)
    taken: set[str] = set()
    unique: list[str] = []
    for place, own in enumerate(given, start=1):
        base = own or f"channel_{place}"
        name, count = base, 1
        while name in taken or (name != own and name in reserved):
            count += 1
            name = f"{base}_{count}"
        taken.add(name)
        unique.append(name)
    return unique


def rate_of_step(step: float, *, resolution: float) -> float:
    """Return the sample rate of a time step.

    Parameters
    ----------
    step : float
        Time step in seconds, greater than 0.
    resolution : float
        Largest error of the step in seconds, e.g. half of the last digit that was written.

    Returns
    -------
    float
        Sample rate in hertz: the whole number, else the multiple of 0.1, that agrees with the step within the
        resolution; the reciprocal of the step if none agrees, or if the resolution leaves several.
    """
    # A step of few digits agrees with many rates; it is exact then: 0.0003 s is not 3333 Hz.
    if resolution > min(5e-5 * step, 0.5 * step * step):
        resolution = min(resolution, 1e-6 * step)
    rate = 1 / step
    for near, coarsest in ((round(rate, 0), np.inf), (round(rate, 1), 0.01 * step * step)):
        if near > 0 and resolution <= coarsest and abs(1 / near - step) <= resolution:
            return near
    return rate
