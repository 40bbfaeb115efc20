"""Sample rates from time steps that files store with some digits only."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from duralab.formats.errors import FormatError

LARGEST_TIME_STEP_ERROR: Final = 1e-3
"""How far a time stamp may lie from an even grid, as a share of the step."""


def rate_of_step(step: float, *, resolution: float) -> float:
    """Return the sample rate in hertz that a time step means."""
    rate = 1 / step
    whole = round(rate)
    return float(whole) if whole > 0 and abs(1 / whole - step) <= resolution else rate


def rate_of_times(path: Path, time: np.ndarray) -> float:
    """Return the sample rate of even time stamps."""
    if time.size < 2:
        raise FormatError(path, f"it holds {time.size} samples; 2 or more are needed to know the sample rate.")
    step = float(time[-1] - time[0]) / (time.size - 1)
    with np.errstate(over="ignore", invalid="ignore"):
        grid = time[0] + step * np.arange(time.size)
        even = np.isfinite(step) and step > 0 and bool((np.abs(time - grid) <= LARGEST_TIME_STEP_ERROR * step).all())
    if not even or not np.isfinite(1 / step):
        steps = np.diff(time)
        worst = int(np.argmax(np.abs(steps - np.median(steps))))
        raise FormatError(
            path,
            f"the time steps differ: {steps[worst]:g} s follows sample {worst}, {np.median(steps):g} s is usual; "
            "an even time that rises was expected.",
        )
    return rate_of_step(step, resolution=1e-9 * step)
