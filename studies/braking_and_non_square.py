"""Beyond six drives and six forces: a rig that brakes, eight by eight, and one with more responses than drives.

`python studies/braking_and_non_square.py` writes picture and tables of docs/studies/braking_and_non_square.md again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from braking_loads import MOMENTS, spindle_model, spindle_rig, spindle_target
from low_level_campaigns import BAND, Trial, campaign, limits_of
from low_level_comparison import ADAPTIVE, BASIC_TWR, DRAWN, SECANT, Algorithm, error_after
from matplotlib.axes import Axes
from numpy.typing import NDArray
from sensor_targets import (
    ACCELERATIONS,
    FORCES,
    GROUPS,
    STRUTS,
    foreign_target,
    of_group,
    own_target,
    sensor_rig,
    weighted_model,
)
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from iterator import RigModel
from rig_sim import PlayableRig


@dataclass(frozen=True)
class Extent:
    """Extent of the study: road, stops of the braking car (from, length), playbacks and levels of identification."""

    seconds: float
    potholes: int
    stops: tuple[tuple[float, float], ...]
    playbacks: int
    told: tuple[int, ...]
    shares: tuple[float, ...]


FULL: Final = Extent(16.0, 2, ((3.0, 1.5), (9.0, 2.5)), 7, (1, 4, 7), (0.1, 1.0))
QUICK: Final = Extent(5.0, 1, ((2.0, 1.5),), 2, (1, 2), (0.3,))
SEED: Final = 1
CONTROLLED: Final = (
    ("the forces", (FORCES,)),
    ("accelerations and strut travel", (ACCELERATIONS, STRUTS)),
    ("all eighteen", GROUPS),
)
_FOREIGN, _OWN = "another vehicle's", "the axle's own"
_BAR: Final = 0.26
_BARS: Final = ("#1b5e9b", "#d9a441", "#3d8b4f")
_DRAWN_SECONDS: Final = 2.6


@dataclass(frozen=True)
class Compromise:
    """Result of the axle with sensors, and error of every response."""

    target: str
    controlled: str
    error: NDArray[np.float64]


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    stopping = spindle_target(extent.seconds, potholes=extent.potholes, stops=extent.stops)
    cruising = spindle_target(extent.seconds, potholes=extent.potholes, stops=())
    braked = {
        share: [_on_spindles(stopping, share, algorithm, extent) for algorithm in DRAWN] for share in extent.shares
    }
    unbraked = {
        share: [_on_spindles(cruising, share, algorithm, extent) for algorithm in DRAWN] for share in extent.shares
    }
    found, on_all = compromises(extent)
    figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.8), layout="constrained")
    drawn = extent.shares[0]
    draw_playbacks(axes[0], braked[drawn], unbraked[drawn], drawn)
    draw_moment(axes[1], stopping, braked[drawn], extent)
    draw_groups(axes[2], [each for each in found if each.target == _FOREIGN])
    tables = (
        braking_table(braked, unbraked, extent),
        groups_table(found, extent),
        algorithms_table(on_all, extent),
    )
    return Findings(figure, "\n\n".join(tables))


def _on_spindles(target: NDArray[np.float64], share: float, algorithm: Algorithm, extent: Extent) -> Trial:
    braking = target.shape[0] > len(FORCES.rows)
    model = spindle_model(share, braking=braking, seed=SEED)
    return _iterated(spindle_rig(braking=braking), target, model, algorithm=algorithm, extent=extent)


def _iterated(
    rig: PlayableRig, target: NDArray[np.float64], model: RigModel, *, algorithm: Algorithm, extent: Extent
) -> Trial:
    """Iterate with the gain 1; drives beyond a limit of the rig are projected to it."""
    return campaign(
        target,
        model=model,
        update=algorithm.settings.model_copy(update={"iteration_gain": (1.0,) * target.shape[0]}),
        playbacks=extent.playbacks,
        rig=rig,
        projected_to=limits_of(rig),
    )


def compromises(extent: Extent) -> tuple[list[Compromise], list[Trial]]:
    """Iterate with every set of controlled responses and both targets; of all eighteen, with every algorithm."""
    foreign = foreign_target(extent.seconds, potholes=extent.potholes)
    found: list[Compromise] = []
    on_all: list[Trial] = []
    own = foreign
    for target_name in (_FOREIGN, _OWN):
        target = foreign if target_name == _FOREIGN else own
        for name, groups in CONTROLLED:
            model = weighted_model(target, groups, seed=SEED)
            trial = _iterated(sensor_rig(), target, model, algorithm=SECANT, extent=extent)
            found.append(Compromise(target_name, name, trial.error[-1]))
            if target_name == _FOREIGN and groups == (FORCES,):
                own = own_target(trial.iterations[-1].drive)
            if groups == GROUPS:
                on_all += [
                    _iterated(sensor_rig(), target, model, algorithm=algorithm, extent=extent)
                    for algorithm in (BASIC_TWR, ADAPTIVE)
                ]
                on_all.append(trial)
    return found, on_all


def draw_playbacks(axes: Axes, braked: list[Trial], unbraked: list[Trial], share: float) -> None:
    """Draw error over playbacks on both rigs."""
    for trials, style, rig in ((braked, "o-", "8×8"), (unbraked, "s--", "6×6")):
        for algorithm, trial in zip(DRAWN, trials, strict=True):
            playback = np.arange(1, trial.overall.size + 1)
            name = f"{algorithm.name}, {rig}"
            axes.semilogy(playback, 100.0 * trial.overall, style, ms=3.5, lw=1.1, color=algorithm.colour, label=name)
    title = f"spindle-coupled rig, identified at {100.0 * share:g} % of the usual level"
    label(axes, title, across="playback", up="relative RMS error, all channels, %")
    plain_numbers(axes)
    axes.legend(loc="best", fontsize=8)


def draw_moment(axes: Axes, target: NDArray[np.float64], trials: list[Trial], extent: Extent) -> None:
    """Draw the left brake moment of the first stop."""
    start = max(0.0, extent.stops[0][0] - 0.4)
    shown = slice(round(start * BAND.sample_rate), round((start + _DRAWN_SECONDS) * BAND.sample_rate))
    seconds = np.arange(target.shape[1])[shown] / BAND.sample_rate
    axes.plot(seconds, target[MOMENTS[0], shown], color="0.25", lw=2.6, alpha=0.45, label="target")
    for number in (0, trials[-1].overall.size - 1):
        colour = "#c0562a" if number == 0 else SECANT.colour
        response = trials[-1].iterations[number].response_in_band[MOMENTS[0], shown]
        axes.plot(seconds, response, color=colour, lw=1.1, label=f"{SECANT.name}, playback {number + 1}")
    label(axes, "left brake moment in the first stop, 0.7 to 35 Hz", across="time, s", up="N·m")
    axes.set_ylim(top=1.5 * target[MOMENTS[0], shown].max())
    axes.legend(loc="upper right", fontsize=8)


def draw_groups(axes: Axes, found: list[Compromise]) -> None:
    """Draw the error of every group of responses for every set of controlled ones."""
    place = np.arange(len(GROUPS))
    for number, each in enumerate(found):
        errors = [100.0 * of_group(each.error, group) for group in GROUPS]
        at = place + (number - 1) * _BAR
        axes.bar(at, errors, 0.9 * _BAR, color=_BARS[number], label=f"controlled: {each.controlled}")
    axes.set_yscale("log")
    axes.set_ylim(top=2e4)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xticks(place, [group.name.replace(" ", "\n", 1) for group in GROUPS], fontsize=8)
    label(axes, "6 drives, 18 responses, another vehicle's target", across="", up="relative RMS error, %")
    axes.legend(loc="upper left", fontsize=8)


def braking_table(braked: dict[float, list[Trial]], unbraked: dict[float, list[Trial]], extent: Extent) -> str:
    """Write the errors on both spindle-coupled rigs."""
    head = ["rig, identified at, algorithm", *(f"after {number}" for number in extent.told), "best"]
    head += [f"worst channel after {extent.playbacks}", "worse brake moment"]
    rows = []
    for rig, by_share in (("8×8, braking", braked), ("6×6", unbraked)):
        for share, trials in by_share.items():
            for algorithm, trial in zip(DRAWN, trials, strict=True):
                row = [f"{rig}, {100.0 * share:g} %, {algorithm.name}"]
                row += [error_after(trial, number) for number in extent.told]
                moments = [trial.error[-1, row_of] for row_of in MOMENTS if row_of < trial.error.shape[1]]
                worst = int(np.argmax(trial.error[-1]))
                name = spindle_rig(braking=bool(moments)).specimen.responses[worst].name.replace("_", " ")
                row.append(percent(float(trial.overall.min())))
                row.append(trial.stopped or f"{name} {percent(float(trial.error[-1, worst]))}")
                row.append(percent(float(max(moments))) if moments else "–")
                rows.append(row)
    return markdown_table(head, rows)


def groups_table(found: list[Compromise], extent: Extent) -> str:
    """Write for every target and every set of controlled responses what each group is left with."""
    rows = []
    for each in found:
        row = [f"{each.target} target, controlled: {each.controlled}"]
        for group in GROUPS:
            row.append(f"{of_group(each.error, group):.3g}")
        rows.append(row)
    head = [f"relative RMS error, secant update, after {extent.playbacks}"]
    return markdown_table([*head, *(group.name for group in GROUPS)], rows)


def algorithms_table(trials: list[Trial], extent: Extent) -> str:
    """Write the errors of every algorithm where all eighteen responses are controlled."""
    names = [f"{name} target, {each.name}" for name in (_FOREIGN, _OWN) for each in (BASIC_TWR, ADAPTIVE, SECANT)]
    rows = [
        [name, *(error_after(trial, number) for number in extent.told), percent(float(trial.overall.min()))]
        for name, trial in zip(names, trials, strict=True)
    ]
    return markdown_table(["all eighteen controlled", *(f"after {number}" for number in extent.told), "best"], rows)


if __name__ == "__main__":
    run("braking_and_non_square", study)
