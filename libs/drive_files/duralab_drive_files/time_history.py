"""Sampled signals with names and units, as a file of a controller holds them."""

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
        One for each row of `samples`.
    sample_rate : float
        In hertz, greater than 0.
    samples : ndarray, shape (channels, samples)
        float64, each row in its channel's unit.
    attributes : mapping of str to str
        What else the file says.
    labels : tuple of str
        Names as the file has them, which need not be unique; empty where they are `names`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    sample_rate: float
    samples: np.ndarray
    attributes: Mapping[str, str] = field(default_factory=dict)
    labels: tuple[str, ...] = ()


def unique_names(names: Iterable[str]) -> list[str]:
    """Return the names, each once, in order.

    Parameters
    ----------
    names : iterable of str
        As a file has them.

    Returns
    -------
    list of str
        An empty one becomes "channel_<place>", from 1; one that stood before gets "_2", "_3" and so on.
    """
    taken: set[str] = set()
    unique: list[str] = []
    for place, given in enumerate(names, start=1):
        base = given.strip() or f"channel_{place}"
        name, count = base, 1
        while name in taken:
            count += 1
            name = f"{base}_{count}"
        taken.add(name)
        unique.append(name)
    return unique


def rate_of_step(step: float, *, resolution: float) -> float:
    """Return the sample rate that a time step means.

    Parameters
    ----------
    step : float
        In seconds, greater than 0.
    resolution : float
        Largest difference to the step of a whole number of hertz that is meant in its place.

    Returns
    -------
    float
        In hertz.
    """
    rate = 1 / step
    whole = round(rate)
    return float(whole) if whole > 0 and abs(1 / whole - step) <= resolution else rate
