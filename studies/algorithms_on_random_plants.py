"""All updates of the iterator on the same random nonlinear rigs, with targets from other vehicles.

`python studies/algorithms_on_random_plants.py` writes picture and table of docs/studies/algorithms_on_random_plants.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from random_plant_campaigns import BAND, Bench, errors_of, make_bench
from random_plants import CHANNELS, SAMPLE_RATE
from study_page import Findings, label, markdown_table, percent, plt, run

from duralab_settings import UpdateKind
from iterator import UpdateSettings


@dataclass(frozen=True)
class Algorithm:
    """One line of the table: its name, colour and settings."""

    name: str
    colour: str
    settings: UpdateSettings


@dataclass(frozen=True)
class Extent:
    """Extent of the study: plants, playbacks, length of the targets in seconds, seeds of other plants."""

    plants: int
    playbacks: int
    seconds: float
    other_seeds: tuple[int, ...]


FULL: Final = Extent(plants=56, playbacks=10, seconds=16.0, other_seeds=(1001, 4004))
QUICK: Final = Extent(plants=2, playbacks=3, seconds=5.0, other_seeds=(1001,))
PLANT_SEED: Final = 1
NOISE_SEED: Final = 2
FORCED_SEED: Final = 7
#: Playbacks after which the table shows the median.
TOLD: Final = (3, 5, 7, 10)
#: An end above this multiple of the best playback counts as run away.
RUN_AWAY: Final = 1.1

_GAIN: Final = np.ones(CHANNELS)
_UNGUARDED: Final = {
    "smallest_correction": 1e-6,
    "largest_correction": 1e6,
    "weigh_by_coherence": False,
    "smooth_lines": False,
}
_SHRUNK: Final = {"lowest_coherence": 0.0}
_RISING: Final = (0.7, 0.8, 0.9, 1.0)

ALGORITHMS: Final = (
    Algorithm(
        "secant update, q 0.7 to 1, segment acceptance",
        "#1b5e9b",
        UpdateSettings(
            band=BAND, iteration_gain=_GAIN, kind=UpdateKind.SECANT, accept_segments=True, gain_schedule=_RISING
        ),
    ),
    Algorithm(
        "Adaptive Modelling, coherence-shrunk, q 0.8, segment acceptance",
        "#3d8b4f",
        UpdateSettings(
            band=BAND, iteration_gain=0.8 * _GAIN, kind=UpdateKind.ADAPTIVE_MODELLING, **_SHRUNK, accept_segments=True
        ),
    ),
    Algorithm(
        "basic TWR, q 0.5, segment acceptance",
        "#d9a441",
        UpdateSettings(band=BAND, iteration_gain=0.5 * _GAIN, kind=UpdateKind.BASIC_TWR, accept_segments=True),
    ),
    Algorithm(
        "basic TWR, q 0.5", "#c0562a", UpdateSettings(band=BAND, iteration_gain=0.5 * _GAIN, kind=UpdateKind.BASIC_TWR)
    ),
    Algorithm(
        "plain Adaptive Modelling, q 0.5",
        "#8c6bb1",
        UpdateSettings(band=BAND, iteration_gain=0.5 * _GAIN, kind=UpdateKind.ADAPTIVE_MODELLING, **_UNGUARDED),
    ),
)


_SECANT: Final = ALGORITHMS[0].settings
#: The secant update with its nonlinear terms, and as a linear update.
VARIANTS: Final = {
    "nonlinear terms": _SECANT,
    "no terms": _SECANT.without_terms,
}


def measure(bench: Bench, algorithm: Algorithm, extent: Extent) -> NDArray[np.float64]:
    """Return the relative RMS error over all channels, shape (plants, playbacks)."""
    return errors_of(bench, algorithm.settings, playbacks=extent.playbacks, seed=NOISE_SEED)


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    bench = make_bench(extent.plants, samples=round(extent.seconds * SAMPLE_RATE), seed=PLANT_SEED)
    errors = [measure(bench, algorithm, extent) for algorithm in ALGORITHMS]
    return findings(errors, terms_table(extent), extent)


def terms_table(extent: Extent) -> str:
    """Tabulate the effect of nonlinear terms on other rigs of the same kind, and on rigs driven by force."""
    rows: list[list[str]] = []
    benches = [(f"seed {seed}", seed, False) for seed in extent.other_seeds]
    for name, seed, forced in (*benches, ("driven by force", FORCED_SEED, True)):
        bench = make_bench(extent.plants, samples=round(extent.seconds * SAMPLE_RATE), seed=seed, forced=forced)
        for variant, settings in VARIANTS.items():
            error = errors_of(bench, settings, playbacks=extent.playbacks, seed=NOISE_SEED)
            rows.append([f"{name}, {variant}", *told_of(error)])
    return markdown_table(["rigs, secant update with", *head_of(extent), "worst"], rows)


def head_of(extent: Extent) -> list[str]:
    """Return the heads of the columns that `told_of` fills."""
    told = [number for number in TOLD if number <= extent.playbacks]
    return [*(f"after {number}" for number in told), f"p90 after {told[-1]}", "ends above 1.1 times its best"]


def told_of(error: NDArray[np.float64]) -> list[str]:
    """Return medians, 90th percentile, ends that ran away and the worst end of one algorithm's errors."""
    told = [number for number in TOLD if number <= error.shape[1]]
    last = error[:, told[-1] - 1]
    return [
        *(percent(float(np.median(error[:, number - 1]))) for number in told),
        percent(float(np.quantile(last, 0.9))),
        f"{np.count_nonzero(error[:, -1] > RUN_AWAY * error.min(axis=1))} of {len(error)}",
        percent(float(last.max())),
    ]


def findings(errors: list[NDArray[np.float64]], terms: str, extent: Extent) -> Findings:
    """Draw and tabulate what was measured, in the order of the algorithms."""
    figure, axes = plt.subplots(1, 2, figsize=(10.5, 4.6), layout="constrained", sharey=True)
    playback = np.arange(1, extent.playbacks + 1)
    for place, share, title in ((axes[0], 0.5, "median"), (axes[1], 0.9, "the worst tenth begins here")):
        for algorithm, error in zip(ALGORITHMS, errors, strict=True):
            spread = np.quantile(error, share, axis=0)
            place.semilogy(playback, spread, "o-", ms=3.5, color=algorithm.colour, label=algorithm.name)
        label(place, f"{extent.plants} plants, {title}", across="playback", up="relative RMS error, all channels")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    rows = [[algorithm.name, *told_of(error)] for algorithm, error in zip(ALGORITHMS, errors, strict=True)]
    table = markdown_table(["algorithm", *head_of(extent), "worst"], rows)
    return Findings(figure, f"{table}\n\n{terms}")


if __name__ == "__main__":
    run("algorithms_on_random_plants", study)
