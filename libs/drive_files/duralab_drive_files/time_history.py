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
        Largest difference from the step of a whole number of hertz, up to which the whole number is returned.

    Returns
    -------
    float
        Sample rate in hertz.
    """
    rate = 1 / step
    whole = round(rate)
    return float(whole) if whole > 0 and abs(1 / whole - step) <= resolution else rate
