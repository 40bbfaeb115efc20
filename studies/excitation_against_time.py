"""Error of the FRF against measurement time, for every excitation, on a damped nonlinear rig and a resonant linear one.

`python studies/excitation_against_time.py` writes picture and table of docs/studies/excitation_against_time.md again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from frf_error import relative_error, root_mean_square
from matplotlib.axes import Axes
from numpy.typing import NDArray
from rig_cell import Record, RigCell
from studied_rigs import AEROSPACE_BLOCK, AXLE_BLOCK, aerospace, front_axle_compliant, long_reference
from study_page import COLOURS, ESTIMATORS, TITLES, Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import EstimatorKind, ExcitationKind
from duralab_spectra import line_frequencies


@dataclass(frozen=True)
class Case:
    """An excitation with the estimator that suits it."""

    kind: ExcitationKind
    estimator: EstimatorKind = EstimatorKind.H1
    delay_blocks: int = 1
    style: str = "o-"

    @property
    def name(self) -> str:
        """For legend and table."""
        delay = f", {self.delay_blocks} delay block{'s' * (self.delay_blocks > 1)}" if self.kind.is_multisine else ""
        return f"{TITLES[self.kind]}, {ESTIMATORS[self.estimator]}{delay}"


#: LPM and LRM need lines closer than resonances are wide: a long stretch of noise has them, single blocks do not.
NOISE = (Case(ExcitationKind.PURE_RANDOM), Case(ExcitationKind.PURE_RANDOM, EstimatorKind.LOCAL_RATIONAL, style="s--"))
BURSTS = (Case(ExcitationKind.BURST_RANDOM), Case(ExcitationKind.SWEPT_SINE))
MULTISINES = tuple(kind for kind in ExcitationKind if kind.is_multisine)


@dataclass(frozen=True)
class Panel:
    """One rig: how it is loaded, what is played on it for how long, seeds, and seconds of a reference.

    A reference of 0 s stands for a rig that knows its FRF.
    """

    load: Callable[[int], RigCell]
    cases: tuple[Case, ...]
    seconds: tuple[float, ...]
    seeds: tuple[int, ...]
    reference_seconds: float
    block_samples: int


AXLE_CASES = (*NOISE, *BURSTS, *(Case(kind) for kind in MULTISINES))
#: Four blocks of 8 s: the first bending mode, 5.4 Hz at 0.5 %, falls to 1/200 in 31 s.
AEROSPACE_CASES = (
    *NOISE,
    *BURSTS,
    *(Case(kind, delay_blocks=4) for kind in MULTISINES),
    Case(ExcitationKind.RANDOM_ORTHOGONAL, delay_blocks=1, style="s--"),
)
FULL = (
    Panel(front_axle_compliant, AXLE_CASES, (30.0, 60.0, 120.0, 240.0), (1, 2, 3), 1200.0, AXLE_BLOCK),
    Panel(aerospace, AEROSPACE_CASES, (60.0, 120.0, 240.0, 480.0, 960.0), (1, 2, 3), 0.0, AEROSPACE_BLOCK),
)
QUICK = (
    Panel(front_axle_compliant, AXLE_CASES, (8.5,), (1,), 10.0, 512),
    Panel(aerospace, AEROSPACE_CASES, (15.0, 60.0), (1,), 0.0, 1024),
)

#: Error by case and by time; None where no whole experiment fits, or the drives are too alike to be distinguished.
Errors = dict[Case, list[float | None]]


def truth(cell: RigCell, panel: Panel) -> tuple[NDArray[np.complex128], float]:
    """Return the FRF that errors are counted from, at every line of the block, and how far it may be off."""
    if panel.reference_seconds > 0.0:
        reference = long_reference(cell, panel.reference_seconds)
        return reference.frf, reference.doubt
    return cell.true_frf(line_frequencies(cell.block_samples, cell.sample_rate)), 0.0


def measure(cell: RigCell, panel: Panel, true: NDArray[np.complex128]) -> Errors:
    """Play every case with every seed once, for the longest time, and estimate from its first parts."""
    errors: Errors = {}
    for case in panel.cases:
        by_seed = []
        for record in cell.play_all(
            cell.settings(case.kind, seconds=panel.seconds[-1], seed=seed, delay_blocks=case.delay_blocks)
            for seed in panel.seeds
        ):
            parts = [record.first(seconds) for seconds in panel.seconds]
            by_seed.append([error_of(cell, part, case.estimator, true) for part in parts])
        errors[case] = [median(values) for values in zip(*by_seed, strict=True)]
    return errors


def error_of(
    cell: RigCell, part: Record | None, estimator: EstimatorKind, true: NDArray[np.complex128]
) -> float | None:
    """Return the error over the lines of the band, None if there are no data for an estimate."""
    if part is None:
        return None
    try:
        estimate = part.estimate(estimator)
    except ValueError:  # fewer experiments than drives, or hardly more: the identifier refuses to divide by chance
        return None
    band = estimate.valid
    return root_mean_square(relative_error(estimate.frf[band], true[band], levels=cell.levels))


def median(values: Sequence[float | None]) -> float | None:
    """Return the median over the seeds, None if one of them has no value."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if len(known) == len(values) else None


def draw(axes: Axes, cell: RigCell, panel: Panel, errors: Errors) -> None:
    """Draw the errors of one rig over time."""
    for case, values in errors.items():
        known = [(seconds, 100.0 * value) for seconds, value in zip(panel.seconds, values, strict=True) if value]
        axes.loglog(*np.transpose(known), case.style, ms=4, color=COLOURS[case.kind], lw=1.2, label=case.name)
    axes.set_xticks(panel.seconds, [f"{seconds:g}" for seconds in panel.seconds])
    axes.xaxis.set_minor_formatter("")
    plain_numbers(axes)
    label(axes, cell.rig.specimen.name, across="measurement time, s", up="relative error of the FRF, %")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)


def table(cell: RigCell, panel: Panel, errors: Errors, doubt: float) -> str:
    """Write the errors of one rig."""
    rows = [
        [case.name, *("too short" if value is None else percent(value) for value in values)]
        for case, values in errors.items()
    ]
    head = [cell.rig.specimen.name, *(f"{seconds:g} s" for seconds in panel.seconds)]
    judge = (
        f"against two experiments of {panel.reference_seconds:g} s, whose mean is known to {percent(doubt)}"
        if panel.reference_seconds > 0.0
        else "against the FRF in closed form"
    )
    return (
        markdown_table(head, rows)
        + f"\n\nRMS over the lines, median of {len(panel.seeds)} seeds, {judge}; blocks of {cell.block_seconds:.3g} s."
    )


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    panels = QUICK if quick else FULL
    figure, all_axes = plt.subplots(1, len(panels), figsize=(11.0, 6.5), layout="constrained")
    tables = []
    for panel, axes in zip(panels, all_axes, strict=True):
        cell = panel.load(panel.block_samples)
        true, doubt = truth(cell, panel)
        errors = measure(cell, panel, true)
        draw(axes, cell, panel, errors)
        tables.append(table(cell, panel, errors, doubt))
    return Findings(figure, "\n\n".join(tables))


if __name__ == "__main__":
    run("excitation_against_time", study)
