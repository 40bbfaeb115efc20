"""Figure 4 of the paper: pure random against pseudo-random with Hadamard decorrelation, for one measurement time.

`python studies/figure_4.py` writes picture and table of docs/studies/figure_4.md again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from frf_error import bias_and_scatter, root_mean_square
from numpy.typing import NDArray
from rig_cell import RigCell
from studied_rigs import AXLE_BLOCK, Reference, long_reference, spindle_coupled
from study_page import COLOURS, ESTIMATORS, TITLES, Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import EstimatorKind, ExcitationKind
from identifier import FrfEstimate

#: The paper's two, and what else the same time can be used for.
CASES = (
    (ExcitationKind.PURE_RANDOM, EstimatorKind.H1),
    (ExcitationKind.HADAMARD, EstimatorKind.H1),
    (ExcitationKind.RANDOM_ORTHOGONAL, EstimatorKind.H1),
    (ExcitationKind.PURE_RANDOM, EstimatorKind.LOCAL_RATIONAL),
)
#: Left longitudinal force by left longitudinal command.
RESPONSE, DRIVE = 2, 2
#: Whole matrices of eight columns, each column a delay and a capture block.
EXPERIMENT_BLOCKS = 16


@dataclass(frozen=True)
class Extent:
    """Extent of the study: whole matrices, seeds, length of a reference in seconds, samples in a block."""

    matrices: int
    seeds: tuple[int, ...]
    reference_seconds: float
    block_samples: int


FULL = Extent(matrices=4, seeds=(1, 2, 3, 4, 5, 6), reference_seconds=1200.0, block_samples=AXLE_BLOCK)
QUICK = Extent(matrices=1, seeds=(1, 2), reference_seconds=10.0, block_samples=512)


@dataclass(frozen=True)
class Outcome:
    """Estimates of one case, one for each seed, and their bias and scatter at each line of the band."""

    estimates: tuple[FrfEstimate, ...]
    bias: NDArray[np.float64]
    scatter: NDArray[np.float64]

    @property
    def roughness(self) -> float:
        """Median over lines and seeds of how far |H| leaps out of the line between its neighbours, relative."""
        leaps = []
        for estimate in self.estimates:
            magnitude = np.abs(estimate.frf[estimate.valid, RESPONSE, DRIVE])
            leaps.append(np.abs(magnitude[1:-1] - (magnitude[:-2] + magnitude[2:]) / 2.0) / magnitude[1:-1])
        return float(np.median(leaps))


def measure(cell: RigCell, reference: Reference, extent: Extent) -> tuple[float, list[Outcome]]:
    """Play every case with every seed for the same time, in seconds."""
    seconds = extent.matrices * EXPERIMENT_BLOCKS * cell.block_seconds + cell.fade_seconds
    records = {
        kind: cell.play_all(cell.settings(kind, seconds=seconds, seed=seed) for seed in extent.seeds)
        for kind in dict.fromkeys(kind for kind, _ in CASES)
    }
    outcomes = []
    for kind, estimator in CASES:
        estimates = tuple(record.estimate(estimator) for record in records[kind])
        band = estimates[0].valid
        frfs = [estimate.frf[band] for estimate in estimates]
        bias, scatter = bias_and_scatter(frfs, reference.frf[band], levels=cell.levels)
        outcomes.append(Outcome(estimates, bias, scatter))
    return seconds, outcomes


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    cell = spindle_coupled(extent.block_samples)
    reference = long_reference(cell, extent.reference_seconds)
    seconds, outcomes = measure(cell, reference, extent)
    figure, axes = plt.subplots(2, 2, figsize=(10.5, 7.5), layout="constrained")
    for place, number in zip(axes[0], (0, 1), strict=True):
        kind = CASES[number][0]
        estimate = outcomes[number].estimates[0]
        band, f = estimate.valid, estimate.frequency[estimate.valid]
        truth = np.abs(reference.frf[band, RESPONSE, DRIVE])
        place.semilogy(f, truth, color="0.35", lw=2.2, alpha=0.5, label="reference")
        found = np.abs(estimate.frf[band, RESPONSE, DRIVE])
        place.semilogy(f, found, color=COLOURS[kind], lw=1.0, label=name_of(number))
        title = f"{TITLES[kind]}, {seconds:.0f} s, {estimate.blocks} blocks"
        label(place, title, across="frequency, Hz", up="left longitudinal FRF, N/N")
        place.legend(loc="upper right")
    plain_numbers(*axes[0])
    styles = ("-", "-", "-", "--")
    for place, title in ((axes[1, 0], "scatter from seed to seed"), (axes[1, 1], "error of the mean of all seeds")):
        for number, (outcome, style) in enumerate(zip(outcomes, styles, strict=True)):
            values = outcome.scatter if place is axes[1, 0] else outcome.bias
            f = outcome.estimates[0].frequency[outcome.estimates[0].valid]
            place.semilogy(f, 100.0 * values, style, color=COLOURS[CASES[number][0]], lw=1.0, label=name_of(number))
        label(place, title, across="frequency, Hz", up="relative, %")
    plain_numbers(*axes[1])
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(CASES))
    return Findings(figure, table(cell, reference, outcomes, seeds=len(extent.seeds)))


def name_of(number: int) -> str:
    """Return the name of a case."""
    kind, estimator = CASES[number]
    return f"{TITLES[kind]}, {ESTIMATORS[estimator]}"


def table(cell: RigCell, reference: Reference, outcomes: list[Outcome], *, seeds: int) -> str:
    """Write blocks, smoothness, scatter and bias of every case."""
    rows = []
    for number, outcome in enumerate(outcomes):
        estimate = outcome.estimates[0]
        floor = np.hypot(root_mean_square(outcome.scatter) / np.sqrt(seeds), reference.doubt)
        rows.append(
            [
                name_of(number),
                f"{estimate.blocks}",
                f"{estimate.independent_averages:.0f}",
                percent(outcome.roughness),
                percent(root_mean_square(outcome.scatter)),
                percent(root_mean_square(outcome.bias)),
                percent(floor),
            ]
        )
    head = ["excitation, estimator", "blocks", "independent averages", "roughness", "scatter"]
    head += ["bias", "bias by chance alone"]
    return (
        markdown_table(head, rows)
        + f"\n\n{seeds} seeds, blocks of {cell.block_seconds:.3g} s; the reference itself is known to "
        f"{percent(reference.doubt)}."
    )


if __name__ == "__main__":
    run("figure_4", study)
