"""Figure 9 of the paper: relative RMS error and RMS response of every channel over the playbacks.

`python studies/figure_9.py` writes picture and tables of docs/studies/figure_9.md again.
"""

from __future__ import annotations

import numpy as np
from low_level_campaigns import BAND, Trial, campaign, identified
from low_level_comparison import (
    ALGORITHMS,
    CHANNELS,
    FULL,
    ONE,
    QUICK,
    SECANT,
    Extent,
    drawn_trials,
    target_of,
    trial_of,
)
from matplotlib.figure import Figure
from study_page import Findings, label, markdown_table, percent, plt, run

from duralab_settings import UpdateKind
from duralab_spectra import rms
from iterator import UpdateSettings


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    tables = (algorithms_table(extent), drives_told(drawn_trials(extent)[1][1]), levels_table(extent))
    return Findings(draw(extent), "\n\n".join(tables))


def draw(extent: Extent) -> Figure:
    """Draw error and RMS response of every channel over the playbacks."""
    figure = plt.figure(figsize=(10.5, 8.0), layout="constrained")
    figure.suptitle("relative RMS error (above) and RMS response (below) of every channel")
    all_axes = figure.subplots(4, 3, sharex=True)
    for row, name in enumerate(CHANNELS):
        side, column = divmod(row, 3)
        for offset, up in ((0, "relative RMS error"), (2, "RMS response")):
            axes = all_axes[offset + side, column]
            for algorithm, trial in drawn_trials(extent):
                values = (trial.error if offset == 0 else trial.rms_response)[:, row]
                playback = np.arange(1, values.size + 1)
                axes.plot(playback, values, "o-", ms=3, color=algorithm.colour, label=algorithm.name)
            label(axes, name, across="", up=up if column == 0 else "")
            if offset == 0:
                axes.set_yscale("log")
            else:
                axes.axhline(1.0, color="0.3", lw=0.8, ls="--")
    for rows in (all_axes[:2], all_axes[2:]):
        limits = np.array([axes.get_ylim() for axes in rows.flat])
        for axes in rows.flat:
            axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
            axes.yaxis.set_major_formatter("{x:g}")
    for axes in all_axes[-1]:
        axes.set_xlabel("playback")
    figure.legend(*all_axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def algorithms_table(extent: Extent) -> str:
    """Write the errors of every algorithm, over all channels and in the worse longitudinal one."""
    head = ["algorithm"]
    for what in ("all channels", "worse longitudinal"):
        head += [f"{what}, after {extent.told[0]}", *(f"after {number}" for number in extent.told[1:])]
    head.append("ends")
    rows = []
    for place, algorithm in enumerate(ALGORITHMS):
        trial = trial_of(place, extent)
        cells = [
            percent(float(errors[number - 1])) if number <= errors.size else "–"
            for errors in (trial.overall, trial.longitudinal)
            for number in extent.told
        ]
        rows.append([algorithm.name, *cells, trial.stopped or f"after {extent.playbacks}"])
    return markdown_table(head, rows)


def drives_told(trial: Trial) -> str:
    """Say what RMS the drives of the last playback had, as what the level of the identification is a share of."""
    found = 1e3 * rms(trial.iterations[-1].drive)
    told = ", ".join(f"{name} {value:.3g}" for name, value in zip(CHANNELS, found, strict=True))
    return f"RMS of the last drive of Adaptive Modelling, mm: {told}."


def levels_table(extent: Extent) -> str:
    """Write what level and gain do to basic TWR and Adaptive Modelling in the worse longitudinal channel."""
    number, early, seed = extent.playbacks, extent.told[1], extent.seeds[0]
    head = ["identified at, of the operational RMS", "gain"]
    head += [f"basic TWR, best and after {number}, seed {seed}" for seed in extent.seeds]
    head += [f"Adaptive Modelling after {number}", "all channels"]
    head += [f"secant update with gain 1 after {early}", "all channels"]
    rows = []
    for share in extent.shares:
        secant = campaign(target_of(extent), model=identified(share, seed), update=SECANT.settings, playbacks=early)
        for gain in extent.gains:
            by_seed = [_tried(UpdateKind.BASIC_TWR, share, seed, gain=gain, extent=extent) for seed in extent.seeds]
            adaptive = _tried(UpdateKind.ADAPTIVE_MODELLING, share, seed, gain=gain, extent=extent)
            row = [f"{100.0 * share:g} %", f"{gain:g}", *(_best_and_last(trial) for trial in by_seed)]
            row += [f"{end:.3f}" for trial in (adaptive, secant) for end in (trial.longitudinal[-1], trial.overall[-1])]
            rows.append(row)
    return markdown_table(head, rows)


def _tried(kind: UpdateKind, share: float, seed: int, *, gain: float, extent: Extent) -> Trial:
    update = UpdateSettings(band=BAND, iteration_gain=gain * ONE, kind=kind)
    return campaign(target_of(extent), model=identified(share, seed), update=update, playbacks=extent.playbacks)


def _best_and_last(trial: Trial) -> str:
    told = f"{trial.longitudinal.min():.2f}, {trial.longitudinal[-1]:.2f}"
    return f"{told} ({trial.stopped})" if trial.stopped else told


if __name__ == "__main__":
    run("figure_9", study)
