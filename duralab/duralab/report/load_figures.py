"""Figures of the loads: rainflow range pairs and range–mean, level crossings, time at level."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from duralab.report.drawing import Figure, axes, line
from duralab.report.series import encode
from duralab.report.waveforms import Shown
from duralab_loads import (
    LoadCycles,
    count_exceeded_ranges,
    count_level_crossings,
    count_load_cycles,
    share_of_time_at_level,
)

LEVELS: Final = 100
"""Number of steps of the curves from the smallest to the largest value."""

TIME_CLASSES: Final = 50
"""Number of classes of time at level; finer ones would show single samples."""

CLASSES: Final = 32
"""Number of classes of range and of mean in a range–mean matrix."""


@dataclass(frozen=True, eq=False)
class CountedLoad:
    """Signal of one channel with its load cycles.

    `name`, `color`: Name and colour of its curve. `samples`, shape (samples): Samples in the channel's unit. `cycles`:
    Cycles counted by rainflow.
    """

    name: str
    color: str
    samples: np.ndarray
    cycles: LoadCycles


def counted_loads(shown: Shown, row: int) -> list[CountedLoad]:
    """Count target, first and best playback of one channel, in the control band."""
    curves = [("target", "@target", shown.target.samples[row])]
    curves += [(name, color, playback.response_in_band.samples[row]) for name, color, playback in shown.first_and_best]
    return [CountedLoad(name, color, samples, count_load_cycles(samples)) for name, color, samples in curves]


def range_pairs(counted: Sequence[CountedLoad], unit: str) -> Figure:
    """Return the figure of ranges over the number of cycles that reach them."""
    top = max((float(load.cycles.ranges.max(initial=0.0)) for load in counted), default=0.0)
    ranges = np.linspace(0.0, top, LEVELS + 1)[1:]
    data = []
    for load in counted:
        exceeded = count_exceeded_ranges(load.cycles, ranges)
        reached = exceeded > 0.0
        # The curve ends at the largest range, not at the last step before it.
        largest = load.cycles.ranges.max(initial=0.0)
        x = np.append(exceeded[reached], count_exceeded_ranges(load.cycles, [largest]))
        data.append(_curve(load, x=x, y=np.append(ranges[reached], largest)))
    layout = axes(x="cycles of that range or more", y=f"range [{unit}]")
    layout["xaxis"] |= {"type": "log", "dtick": 1}
    layout["yaxis"]["rangemode"] = "tozero"
    return {"data": data, "layout": layout}


def level_crossings(counted: Sequence[CountedLoad], unit: str) -> Figure:
    """Return the figure of levels over the number of upward crossings."""
    levels = _levels(counted, LEVELS)
    data = []
    for load in counted:
        crossings = count_level_crossings(load.samples, levels)
        passed = crossings > 0
        data.append(_curve(load, x=crossings[passed], y=levels[passed]))
    layout = axes(x="crossings upward", y=f"level [{unit}]")
    layout["xaxis"] |= {"type": "log", "dtick": 1}
    return {"data": data, "layout": layout}


def time_at_level(counted: Sequence[CountedLoad], unit: str) -> Figure:
    """Return the figure of levels over the share of the time spent at them."""
    edges = _levels(counted, TIME_CLASSES)
    centres = 0.5 * (edges[:-1] + edges[1:])
    data = []
    for load in counted:
        shares = 100.0 * share_of_time_at_level(load.samples, edges)
        visited = shares > 0.0
        data.append(_curve(load, x=shares[visited], y=centres[visited]))
    layout = axes(x="share of the time [%]", y=f"level [{unit}]")
    layout["xaxis"] |= {"type": "log", "dtick": 1}
    return {"data": data, "layout": layout}


def range_mean(counted: Sequence[CountedLoad], place: int, unit: str) -> Figure:
    """Return the figure of one signal's number of cycles per class of range and mean; all signals share the classes."""
    ranges = np.concatenate([load.cycles.ranges for load in counted])
    means = np.concatenate([load.cycles.means for load in counted])
    top = float(ranges.max(initial=0.0)) or 1.0
    middle, reach = (float(means.min() + means.max()) / 2, float(np.ptp(means)) / 2) if means.size else (0.0, 0.0)
    reach = max(reach, 0.05 * top)
    bins = (np.linspace(0.0, top, CLASSES + 1), np.linspace(middle - reach, middle + reach, CLASSES + 1))

    def matrix(cycles: LoadCycles) -> np.ndarray:
        return np.histogram2d(cycles.ranges, cycles.means, bins=bins, weights=cycles.counts)[0]

    matrices = [matrix(load.cycles) for load in counted]
    most = max(float(counts.max()) for counts in matrices)
    counts = matrices[place]
    logarithm = np.full_like(counts, np.nan)
    np.log10(counts, out=logarithm, where=counts > 0.0)
    ticks = [tick for tick in (0.5, 1, 10, 100, 1e3, 1e4, 1e5, 1e6) if tick <= max(most, 1.0)]
    layout = axes(x=f"mean [{unit}]", y=f"range [{unit}]")
    return {
        "data": [
            {
                "type": "heatmap",
                "name": counted[place].name,
                "x": encode(0.5 * (bins[1][:-1] + bins[1][1:])),
                "y": encode(0.5 * (bins[0][:-1] + bins[0][1:])),
                "z": _matrix(logarithm),
                "zmin": float(np.log10(0.5)),
                "zmax": float(np.log10(max(most, 1.0))),
                "colorscale": [[0, "@faint"], [1, "@last"]],
                "colorbar": {
                    "title": {"text": "cycles", "font": {"size": 11}},
                    "tickvals": [float(np.log10(tick)) for tick in ticks],
                    "ticktext": [f"{tick:g}" for tick in ticks],
                    "thickness": 10,
                    "outlinewidth": 0,
                },
                "hovertemplate": "range %{y:.4g}, mean %{x:.4g}<extra></extra>",
            }
        ],
        "layout": layout,
    }


def _levels(counted: Sequence[CountedLoad], steps: int) -> np.ndarray:
    """Return steps over the range of all signals; for constant signals, one unit to either side."""
    least = min(float(load.samples.min()) for load in counted)
    greatest = max(float(load.samples.max()) for load in counted)
    margin = 0.0 if greatest > least else 1.0
    return np.linspace(least - margin, greatest + margin, steps + 1)


def _curve(load: CountedLoad, *, x: np.ndarray, y: np.ndarray) -> Figure:
    dash = "dot" if load.color == "@first" else "solid"
    return line(
        load.name, load.color, width=2.2 if load.color == "@target" else 1.4, dash=dash, x=encode(x), y=encode(y)
    )


def _matrix(values: np.ndarray) -> dict[str, str]:
    content = base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()
    return {"dtype": "f4", "bdata": content, "shape": f"{values.shape[0]}, {values.shape[1]}"}
