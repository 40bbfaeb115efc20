"""Effect of noise, a softening rig, the identification's level and the block size on each update.

`python studies/sensitivity.py` writes picture and tables of docs/studies/sensitivity.md again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from algorithms_on_random_plants import ALGORITHMS, NOISE_SEED, PLANT_SEED, Algorithm
from matplotlib.axes import Axes
from numpy.typing import NDArray
from random_plant_campaigns import BAND, Bench, Conditions, errors_of, make_bench
from random_plants import CHANNELS, SAMPLE_RATE
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import CorrectionShape, UpdateKind
from iterator import UpdateSettings

_FULL_CORRECTION: Final = Algorithm(
    "Adaptive Modelling, full correction, q 0.8, segment acceptance",
    "#8c6bb1",
    UpdateSettings(
        band=BAND,
        iteration_gain=np.full(CHANNELS, 0.8),
        kind=UpdateKind.ADAPTIVE_MODELLING,
        correction=CorrectionShape.FULL,
        accept_segments=True,
    ),
)
#: The first two and the paper's basic TWR of the other study, and the correction that couples channels.
COMPARED: Final = (ALGORITHMS[0], ALGORITHMS[1], _FULL_CORRECTION, ALGORITHMS[3])


@dataclass(frozen=True)
class Condition:
    """One thing that is varied: its name, its values, how they are told, and the conditions with it."""

    name: str
    values: tuple[float, ...]
    told: Callable[[float], str]
    with_value: Callable[[float], Conditions]


def _share(value: float) -> str:
    return f"{100.0 * value:g} %"


USUAL: Final = Conditions()
VARIED: Final = (
    Condition(
        "noise, of the target's RMS", (0.001, 0.01, 0.03, 0.1), _share, lambda value: replace(USUAL, noise=value)
    ),
    Condition(
        "softening from playback to playback",
        (0.0, 0.005, 0.02, 0.05),
        _share,
        lambda value: replace(USUAL, softening=value),
    ),
    Condition(
        "level of the identification, of the target's drive",
        (0.05, 0.12, 0.4, 1.0),
        _share,
        lambda value: replace(USUAL, level=value),
    ),
    Condition(
        "block, s",
        (1.0, 2.0, 4.0, 8.0),
        lambda value: f"{value:g} s",
        lambda value: replace(USUAL, block_samples=round(value * SAMPLE_RATE)),
    ),
)


@dataclass(frozen=True)
class Extent:
    """Extent of the study: plants, playbacks, seconds of the targets, and values of each condition."""

    plants: int
    playbacks: int
    seconds: float
    places: tuple[int, ...]


FULL: Final = Extent(plants=12, playbacks=7, seconds=16.0, places=(0, 1, 2, 3))
QUICK: Final = Extent(plants=1, playbacks=2, seconds=6.0, places=(1, 2))


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    figure, panels = plt.subplots(1, len(VARIED), figsize=(13.0, 4.6), layout="constrained", sharey=True)
    tables = []
    for condition, axes in zip(VARIED, panels, strict=True):
        values = tuple(condition.values[place] for place in extent.places)
        errors = [
            [last_errors(condition.with_value(value), number, extent) for value in values]
            for number in range(len(COMPARED))
        ]
        draw(axes, condition, values, errors)
        tables.append(table(condition, values, errors))
    panels[0].set_ylabel("relative RMS error, all channels, %")
    plain_numbers(*panels)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2)
    shown = "median, and up to where nine tenths are"
    figure.suptitle(f"{extent.plants} plants, after playback {extent.playbacks}: {shown}")
    return Findings(figure, "\n\n".join(tables))


@cache
def bench_of(conditions: Conditions, extent: Extent) -> Bench:
    """Return rigs, targets and models; all conditions have the same rigs and targets."""
    samples = round(extent.seconds * SAMPLE_RATE)
    return make_bench(extent.plants, samples=samples, seed=PLANT_SEED, conditions=conditions)


@cache
def last_errors(conditions: Conditions, number: int, extent: Extent) -> NDArray[np.float64]:
    """Return the relative RMS error of the last playback on every plant, of the algorithm of that place."""
    # Softening does not change what is identified before the first playback.
    bench = replace(bench_of(replace(conditions, softening=0.0), extent), conditions=conditions)
    return errors_of(bench, COMPARED[number].settings, playbacks=extent.playbacks, seed=NOISE_SEED)[:, -1]


def draw(axes: Axes, condition: Condition, values: tuple[float, ...], errors: list[list[NDArray[np.float64]]]) -> None:
    """Draw the errors of every algorithm over what is varied."""
    place = np.arange(len(values))
    for algorithm, found in zip(COMPARED, errors, strict=True):
        median, most = (100.0 * np.quantile(found, share, axis=1) for share in (0.5, 0.9))
        axes.semilogy(place, median, "o-", ms=4, color=algorithm.colour, label=algorithm.name)
        axes.fill_between(place, median, most, color=algorithm.colour, alpha=0.12, lw=0.0)
    axes.set_xticks(place, [condition.told(value) for value in values])
    label(axes, "", across=condition.name, up="")


def table(condition: Condition, values: tuple[float, ...], errors: list[list[NDArray[np.float64]]]) -> str:
    """Write median and 90th percentile for every algorithm and value."""
    head = [condition.name, *(condition.told(value) for value in values)]
    rows = [
        [
            algorithm.name,
            *(f"{percent(float(np.median(each)))}, {percent(float(np.quantile(each, 0.9)))}" for each in found),
        ]
        for algorithm, found in zip(COMPARED, errors, strict=True)
    ]
    return markdown_table(head, rows)


if __name__ == "__main__":
    run("sensitivity", study)
