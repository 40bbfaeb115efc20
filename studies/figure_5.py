"""Figure 5 of the paper: a lightly damped structure whose FRF is known, identified by noise and by multisines.

`python studies/figure_5.py` writes picture and table of docs/studies/figure_5.md again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from frf_error import bias_and_scatter, root_mean_square
from numpy.typing import NDArray
from rig_cell import RigCell
from studied_rigs import AEROSPACE_BLOCK, aerospace
from study_page import COLOURS, Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import EstimatorKind, ExcitationKind
from identifier import FrfEstimate
from rig_sim.structure import StructureRig

#: Around the two torsion modes of the wing, where the damping is least.
ZOOM = (29.5, 35.0)
#: Distance from a resonance, in half-power widths 2 zeta f, up to which a line counts as near it.
NEAR = 2.0


@dataclass(frozen=True)
class Case:
    """One way to spend the measurement time."""

    name: str
    kind: ExcitationKind
    estimator: EstimatorKind
    delay_blocks: int
    colour: str
    style: str


PURE, HADAMARD = ExcitationKind.PURE_RANDOM, ExcitationKind.HADAMARD
CASES = (
    Case("pure random, Hann, H1", PURE, EstimatorKind.H1, 1, COLOURS[PURE], "-"),
    Case("Hadamard, 1 delay block", HADAMARD, EstimatorKind.H1, 1, "#55a7c9", "-"),
    Case("Hadamard, 4 delay blocks", HADAMARD, EstimatorKind.H1, 4, COLOURS[HADAMARD], "-"),
    Case("pure random, LPM", PURE, EstimatorKind.LOCAL_POLYNOMIAL, 1, "#d9a441", "--"),
    Case("pure random, LRM", PURE, EstimatorKind.LOCAL_RATIONAL, 1, "black", "--"),
)
#: Cases in the upper picture, where more curves would hide each other.
DRAWN = (0, 2)


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds, seeds, samples in a block."""

    seconds: float
    seeds: tuple[int, ...]
    block_samples: int


#: Two Hadamard matrices of four columns with five blocks each, or five with two, and a fade.
FULL = Extent(seconds=321.0, seeds=(1, 2, 3, 4, 5, 6), block_samples=AEROSPACE_BLOCK)
QUICK = Extent(seconds=41.0, seeds=(1, 2), block_samples=AEROSPACE_BLOCK // 4)


@dataclass(frozen=True)
class Outcome:
    """The first estimate of a case; over all seeds its error, bias and scatter at each line of the band."""

    estimate: FrfEstimate
    bias: NDArray[np.float64]
    scatter: NDArray[np.float64]

    @property
    def error(self) -> NDArray[np.float64]:
        """Of one experiment, expected."""
        return np.hypot(self.bias, self.scatter)


def measure(cell: RigCell, case: Case, extent: Extent) -> Outcome:
    """Play a case with every seed."""
    records = cell.play_all(
        cell.settings(case.kind, seconds=extent.seconds, seed=seed, delay_blocks=case.delay_blocks)
        for seed in extent.seeds
    )
    estimates = [record.estimate(case.estimator) for record in records]
    band = estimates[0].valid
    true = cell.true_frf(estimates[0].frequency[band])
    bias, scatter = bias_and_scatter([estimate.frf[band] for estimate in estimates], true, levels=cell.levels)
    return Outcome(estimates[0], bias, scatter)


def near_resonances(cell: RigCell, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the lines that are near a resonance of the structure."""
    assert isinstance(cell.rig, StructureRig)
    modes = cell.rig.modes
    distance = np.abs(frequency[:, None] - modes.frequency)
    return np.any(distance <= NEAR * 2.0 * modes.damping * modes.frequency, axis=1)


def table(cell: RigCell, outcomes: list[Outcome], extent: Extent) -> str:
    """Write the error of every case, near resonances and elsewhere."""
    rows = []
    for case, outcome in zip(CASES, outcomes, strict=True):
        near = near_resonances(cell, outcome.estimate.frequency[outcome.estimate.valid])
        rows.append(
            [
                case.name,
                f"{outcome.estimate.blocks}",
                percent(root_mean_square(outcome.error)),
                percent(float(np.median(outcome.error))),
                percent(root_mean_square(outcome.bias[near])),
                percent(root_mean_square(outcome.scatter[near])),
                percent(root_mean_square(outcome.bias[~near])),
                percent(root_mean_square(outcome.scatter[~near])),
            ]
        )
    head = [
        "excitation",
        "blocks",
        "error, RMS over lines",
        "median over lines",
        "bias near resonances",
        "scatter there",
    ]
    head += ["bias elsewhere", "scatter there"]
    return (
        markdown_table(head, rows)
        + f"\n\n{extent.seconds:.0f} s each, {len(extent.seeds)} seeds, blocks of {cell.block_seconds:.3g} s. Near a "
        f"resonance is within {NEAR:g} half-power widths of it.\nOf {len(extent.seeds)} seeds a bias below "
        f"{1.0 / np.sqrt(len(extent.seeds)):.2f} times the scatter is not told from scatter."
    )


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    cell = aerospace(extent.block_samples)
    outcomes = [measure(cell, case, extent) for case in CASES]
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 7.8), layout="constrained", width_ratios=(1.7, 1.0))
    band = outcomes[0].estimate.valid
    f = outcomes[0].estimate.frequency[band]
    for place, limits in ((axes[0, 0], (f[0], f[-1])), (axes[0, 1], ZOOM)):
        fine = np.linspace(*limits, 6000)
        place.semilogy(fine, np.abs(cell.true_frf(fine)[:, 0, 0]), color="0.35", lw=2.0, alpha=0.45, label="true")
        shown = (f >= limits[0]) & (f <= limits[1])
        for number in DRAWN:
            case, found = CASES[number], np.abs(outcomes[number].estimate.frf[band, 0, 0])
            points = "." if limits == ZOOM else ""
            place.semilogy(f[shown], found[shown], points + "-", color=case.colour, lw=0.8, ms=4, label=case.name)
        label(place, "left wing by left wing", across="frequency, Hz", up="acceleration per force, (m/s²)/N")
    axes[0, 0].legend(loc="lower right")
    for place, limits in ((axes[1, 0], (f[0], f[-1])), (axes[1, 1], ZOOM)):
        shown = (f >= limits[0]) & (f <= limits[1])
        for case, outcome in zip(CASES, outcomes, strict=True):
            error = 100.0 * outcome.error[shown]
            place.semilogy(f[shown], error, case.style, color=case.colour, lw=0.9, label=case.name)
        label(place, "error, all channels", across="frequency, Hz", up="relative error of the FRF, %")
    plain_numbers(*axes[1])
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(CASES))
    return Findings(figure, table(cell, outcomes, extent))


if __name__ == "__main__":
    run("figure_5", study)
