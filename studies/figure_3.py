"""Figure 3 of the paper: effect of Hadamard decorrelation on the FRF of a spindle-coupled rig, for one record length.

`python studies/figure_3.py` writes picture and table of docs/studies/figure_3.md again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from frf_error import relative_error, root_mean_square
from numpy.typing import NDArray
from rig_cell import RigCell
from studied_rigs import AXLE_BLOCK, Reference, long_reference, spindle_coupled
from study_page import COLOURS, TITLES, Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import ExcitationKind
from identifier import FrfEstimate

KINDS = (ExcitationKind.PSEUDO_RANDOM, ExcitationKind.HADAMARD, ExcitationKind.RANDOM_ORTHOGONAL)
#: Order of the Hadamard matrix for six drives; each column is one delay and one capture block.
COLUMNS, BLOCKS_PER_COLUMN = 8, 2
#: Left longitudinal force by left longitudinal command: the channel of the paper's trouble.
RESPONSE, DRIVE = 2, 2


@dataclass(frozen=True)
class Extent:
    """Extent of the study: whole Hadamard matrices, seeds, length of a reference in seconds, samples in a block."""

    matrices: tuple[int, ...]
    seeds: tuple[int, ...]
    reference_seconds: float
    block_samples: int


FULL = Extent(matrices=(1, 2, 4, 8), seeds=(1, 2, 3), reference_seconds=1200.0, block_samples=AXLE_BLOCK)
QUICK = Extent(matrices=(1, 2), seeds=(1,), reference_seconds=10.0, block_samples=512)


@dataclass(frozen=True)
class Outcome:
    """Result of one experiment: the estimate, and its error at each line of the band."""

    estimate: FrfEstimate
    error: NDArray[np.float64]

    @property
    def condition(self) -> NDArray[np.float64]:
        """Condition number of S_uu, at each line of the band."""
        return self.estimate.condition_number[self.estimate.valid]


Outcomes = dict[tuple[ExcitationKind, int], list[Outcome]]


def seconds_of(cell: RigCell, matrices: int) -> float:
    """Return the duration of a number of whole Hadamard matrices."""
    return matrices * COLUMNS * BLOCKS_PER_COLUMN * cell.block_seconds + cell.fade_seconds


def measure(cell: RigCell, reference: Reference, extent: Extent) -> Outcomes:
    """Play every kind with every seed, and estimate from the first part of each as well as from all of it."""
    found: Outcomes = {}
    for kind in KINDS:
        longest = seconds_of(cell, max(extent.matrices))
        for record in cell.play_all(cell.settings(kind, seconds=longest, seed=seed) for seed in extent.seeds):
            for matrices in extent.matrices:
                part = record.first(seconds_of(cell, matrices))
                assert part is not None
                estimate = part.estimate()
                band = estimate.valid
                error = relative_error(estimate.frf[band], reference.frf[band], levels=cell.levels)
                found.setdefault((kind, matrices), []).append(Outcome(estimate, error))
    return found


def median_error(outcomes: list[Outcome]) -> float:
    """Return the median over the seeds of the error over the lines."""
    return float(np.median([root_mean_square(outcome.error) for outcome in outcomes]))


def table(cell: RigCell, reference: Reference, found: Outcomes, extent: Extent) -> str:
    """Write condition and error for every length."""
    rows = []
    for matrices in extent.matrices:
        row = [f"{seconds_of(cell, matrices):.0f} s"]
        for kind in KINDS:
            outcomes = found[kind, matrices]
            worst = np.median([outcome.condition.max() for outcome in outcomes])
            row += [f"{worst:.3g}", percent(median_error(outcomes))]
        rows.append(row)
    head = ["record"]
    for kind in KINDS:
        head += [f"{TITLES[kind]}: worst condition of S_uu", "error of the FRF"]
    return (
        markdown_table(head, rows)
        + f"\n\nMedians of {len(extent.seeds)} seeds. The reference itself is known to {percent(reference.doubt)}."
    )


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    cell = spindle_coupled(extent.block_samples)
    reference = long_reference(cell, extent.reference_seconds)
    found = measure(cell, reference, extent)
    figure, axes = plt.subplots(2, 2, figsize=(10.5, 7.5), layout="constrained")
    first = extent.matrices[0]
    seconds = seconds_of(cell, first)
    for kind, place in zip(KINDS, (axes[0, 0], axes[0, 1]), strict=False):
        estimate = found[kind, first][0].estimate
        band, f = estimate.valid, estimate.frequency[estimate.valid]
        place.semilogy(
            f, np.abs(reference.frf[band, RESPONSE, DRIVE]), color="0.35", lw=2.2, alpha=0.5, label="reference"
        )
        place.semilogy(f, np.abs(estimate.frf[band, RESPONSE, DRIVE]), color=COLOURS[kind], lw=1.0, label=TITLES[kind])
        label(place, f"{TITLES[kind]}, {seconds:.0f} s", across="frequency, Hz", up="left longitudinal FRF, N/N")
        place.legend(loc="upper right")
        axes[1, 0].semilogy(f, found[kind, first][0].condition, color=COLOURS[kind], label=TITLES[kind])
    plain_numbers(*axes[0])
    label(axes[1, 0], f"condition number of S_uu, {seconds:.0f} s", across="frequency, Hz", up="condition number")
    axes[1, 0].set_ylim(0.7, 1000.0)
    plain_numbers(axes[1, 0])
    axes[1, 0].legend(loc="upper right")
    times = [seconds_of(cell, matrices) for matrices in extent.matrices]
    for kind in KINDS:
        errors = [100.0 * median_error(found[kind, matrices]) for matrices in extent.matrices]
        axes[1, 1].loglog(times, errors, "o-", color=COLOURS[kind], label=TITLES[kind])
    axes[1, 1].axhline(100.0 * reference.doubt, color="0.5", ls=":", label="doubt of the reference")
    axes[1, 1].set_xticks(times, [f"{time:.0f}" for time in times])
    axes[1, 1].minorticks_off()
    label(
        axes[1, 1], "error over all lines and channels", across="measurement time, s", up="relative error of the FRF, %"
    )
    plain_numbers(axes[1, 1])
    axes[1, 1].legend(loc="upper right")
    return Findings(figure, table(cell, reference, found, extent))


if __name__ == "__main__":
    run("figure_3", study)
