"""Figures 7, 8 and 9 of the paper: basic TWR and Adaptive Modelling on a rig identified while its friction sticks.

`python studies/figure_7_8_9.py` writes picture and tables of docs/studies/figure_7_8_9.md again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from low_level_campaigns import BAND, LONGITUDINAL, OPERATIONAL, Trial, campaign, identified, predecessor_target
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from iterator import (
    AcceptanceSettings,
    CorrectionSettings,
    RigModel,
    UpdateKind,
    UpdateSettings,
    overlay_spectra,
)
from spectra import rms


@dataclass(frozen=True)
class Algorithm:
    """A row of the first table; those with a colour are drawn."""

    name: str
    settings: UpdateSettings
    colour: str = ""


@dataclass(frozen=True)
class Extent:
    """How much is played: seconds of road, potholes, playbacks, and what the second table varies."""

    seconds: float
    potholes: int
    playbacks: int
    told: tuple[int, ...]
    shares: tuple[float, ...]
    gains: tuple[float, ...]
    seeds: tuple[int, ...]


FULL: Final = Extent(30.0, 4, 7, (1, 4, 7), (0.05, 0.1, 0.15), (0.5, 0.8, 1.0), (1, 2))
QUICK: Final = Extent(6.0, 1, 2, (1, 2), (0.1,), (0.6,), (1,))
#: Of the operational drive RMS, in the figures and the first table.
SHARE: Final = 0.1
CHANNELS: Final = tuple(
    f"{side} {axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal")
)
DRAWN_SECONDS: Final = 1.5
_SPECTRUM_BLOCK: Final = 2048
#: N²/Hz; below is what the flank of the control band leaves of the target.
_LOWEST_DENSITY: Final = 1.0

_ONE: Final = np.ones(OPERATIONAL.size)
_SAFE: Final = AcceptanceSettings()
_UNGUARDED: Final = CorrectionSettings(smallest=1e-6, largest=1e6, weigh_by_coherence=False, smooth_lines=False)
_TWR, _AM, _SECANT = UpdateKind.BASIC_TWR, UpdateKind.ADAPTIVE_MODELLING, UpdateKind.SECANT

ALGORITHMS: Final = (
    Algorithm("basic TWR", UpdateSettings(BAND, _ONE, _TWR), "#c0562a"),
    Algorithm("Adaptive Modelling", UpdateSettings(BAND, _ONE, _AM), "#3d8b4f"),
    Algorithm("secant update, segment acceptance", UpdateSettings(BAND, _ONE, _SECANT, acceptance=_SAFE), "#1b5e9b"),
    Algorithm("plain Adaptive Modelling, no safeguards", UpdateSettings(BAND, _ONE, _AM, _UNGUARDED)),
    Algorithm("Adaptive Modelling, segment acceptance", UpdateSettings(BAND, _ONE, _AM, acceptance=_SAFE)),
    Algorithm("basic TWR, segment acceptance", UpdateSettings(BAND, _ONE, _TWR, acceptance=_SAFE)),
    Algorithm(
        "secant update, gain 0.7 to 1, segment acceptance",
        UpdateSettings(BAND, _ONE, _SECANT, acceptance=_SAFE, gain_schedule=(0.7, 0.8, 0.9, 1.0)),
    ),
)


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    target = predecessor_target(extent.seconds, potholes=extent.potholes)
    model = identified(SHARE, extent.seeds[0])
    trials = [
        campaign(target, model=model, update=algorithm.settings, playbacks=extent.playbacks) for algorithm in ALGORITHMS
    ]
    figure = draw(target, model, trials, extent)
    operational = identified(1.0, extent.seeds[0])
    tables = (
        algorithms_table(trials, extent),
        drives_told(trials[1]),
        prediction_told(model, operational, extent.gains),
        levels_table(target, extent),
    )
    return Findings(figure, "\n\n".join(tables))


def draw(target: NDArray[np.float64], model: RigModel, trials: list[Trial], extent: Extent) -> Figure:
    """Draw all three figures below each other."""
    figure = plt.figure(figsize=(10.5, 15.5), layout="constrained")
    grid = figure.add_gridspec(3, 1, height_ratios=(1.05, 0.75, 1.5))
    waves, spectra, steps = (figure.add_subfigure(grid[row, 0]) for row in range(3))
    drawn = [(algorithm, trial) for algorithm, trial in zip(ALGORITHMS, trials, strict=True) if algorithm.colour]
    # The channel that basic TWR leaves worst.
    channel = max(LONGITUDINAL, key=lambda row: drawn[0][1].error[-1, row])
    _draw_waves(waves, target, drawn, channel)
    _draw_spectra(spectra, target, drawn, channel)
    _draw_model(spectra.axes[1], model, identified(1.0, extent.seeds[0]), channel)
    _draw_steps(steps, drawn)
    return figure


def _draw_waves(
    place: SubFigure, target: NDArray[np.float64], drawn: list[tuple[Algorithm, Trial]], channel: int
) -> None:
    count = round(DRAWN_SECONDS * BAND.sample_rate)
    # Where basic TWR, the first one drawn, is furthest off.
    missed = (target - drawn[0][1].iterations[-1].response_in_band)[channel]
    middle = int(np.argmax(np.abs(missed[count:-count]))) + count
    shown = slice(middle - count // 2, middle + count // 2)
    seconds = np.arange(target.shape[1])[shown] / BAND.sample_rate
    last = len(drawn[0][1].iterations)
    place.suptitle(f"Figure 7: {CHANNELS[channel]} force in playback {last}, where basic TWR is furthest off")
    panels = place.subplots(3, 1, sharex=True, sharey=True)
    for axes, (algorithm, trial) in zip(panels, drawn, strict=True):
        response = trial.iterations[-1].response_in_band[channel, shown]
        axes.plot(seconds, target[channel, shown] / 1e3, color="0.25", lw=2.4, alpha=0.45, label="target")
        axes.plot(seconds, response / 1e3, color=algorithm.colour, lw=1.1, label="response")
        label(axes, algorithm.name, across="", up="force, kN")
        axes.legend(loc="upper right")
    panels[-1].set_xlabel("time, s")
    panels[-1].set_xlim(seconds[0], seconds[-1])


def _draw_spectra(
    place: SubFigure, target: NDArray[np.float64], drawn: list[tuple[Algorithm, Trial]], channel: int
) -> None:
    place.suptitle("Figure 8, and why")
    axes = place.subplots(1, 2)[0]
    for number, (algorithm, trial) in enumerate(drawn):
        overlay = overlay_spectra(
            target,
            trial.iterations[-1].response_in_band,
            sample_rate=BAND.sample_rate,
            block_samples=_SPECTRUM_BLOCK,
        )
        seen = (overlay.frequency >= BAND.lowest) & (overlay.frequency <= BAND.highest)
        if number == 0:
            axes.semilogy(
                overlay.frequency[seen], overlay.target[seen, channel], color="0.25", lw=2.6, alpha=0.45, label="target"
            )
        axes.semilogy(
            overlay.frequency[seen],
            overlay.response[seen, channel],
            color=algorithm.colour,
            lw=1.1,
            label=algorithm.name,
        )
    axes.set_ylim(bottom=_LOWEST_DENSITY)
    label(axes, f"PSD, {CHANNELS[channel]}, playback {len(drawn[0][1].iterations)}", across="frequency, Hz", up="N²/Hz")
    axes.legend(loc="best")


def _draw_model(axes: Axes, low: RigModel, operational: RigModel, channel: int) -> None:
    seen = (low.frequency >= BAND.lowest) & (low.frequency <= BAND.highest)
    for model, colour, name in (
        (low, "#c0562a", f"at {100.0 * SHARE:g} % of the operational level"),
        (operational, "0.25", "at operational level"),
    ):
        magnitude = np.abs(model.frf[seen, channel, channel]) / 1e6
        axes.semilogy(low.frequency[seen], magnitude, color=colour, label=name)
    label(axes, f"FRF, {CHANNELS[channel]}, as identified", across="frequency, Hz", up="kN/mm")
    plain_numbers(axes)
    axes.legend(loc="best")


def _draw_steps(place: SubFigure, drawn: list[tuple[Algorithm, Trial]]) -> None:
    place.suptitle("Figure 9: relative RMS error (above) and RMS response (below) of every channel")
    all_axes = place.subplots(4, 3, sharex=True)
    for row, name in enumerate(CHANNELS):
        side, column = divmod(row, 3)
        for offset, up in ((0, "relative RMS error"), (2, "RMS response")):
            axes = all_axes[offset + side, column]
            for algorithm, trial in drawn:
                values = (trial.error if offset == 0 else trial.rms_response)[:, row]
                axes.plot(
                    np.arange(1, values.size + 1), values, "o-", ms=3, color=algorithm.colour, label=algorithm.name
                )
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
    place.legend(*all_axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def algorithms_table(trials: list[Trial], extent: Extent) -> str:
    """Write the errors of every algorithm, over all channels and in the worse longitudinal one."""
    head = ["algorithm"]
    for what in ("all channels", "worse longitudinal"):
        head += [f"{what}, after {extent.told[0]}", *(f"after {number}" for number in extent.told[1:])]
    head.append("ends")
    rows = []
    for algorithm, trial in zip(ALGORITHMS, trials, strict=True):
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


def prediction_told(model: RigModel, operational: RigModel, gains: tuple[float, ...]) -> str:
    """Say by how much Eq. 6 lets the error grow where the rig is the one of the operational level."""
    seen = (model.frequency >= BAND.lowest) & (model.frequency <= BAND.highest)
    product = operational.frf[seen] @ model.inverse_frf[seen]
    told = []
    for gain in gains:
        radius = np.abs(np.linalg.eigvals(np.eye(OPERATIONAL.size) - gain * product)).max(axis=1)
        worst = int(np.argmax(radius))
        told.append(f"{radius[worst]:.2f} at {model.frequency[seen][worst]:.1f} Hz with gain {gain:g}")
    return (
        f"Spectral radius of Eq. 6, the operational model standing for the rig, at its worst line: {'; '.join(told)}."
    )


def levels_table(target: NDArray[np.float64], extent: Extent) -> str:
    """Write what level and gain do to basic TWR and Adaptive Modelling in the worse longitudinal channel."""
    number = extent.playbacks
    head = ["identified at, of the operational RMS", "gain"]
    head += [f"basic TWR, best and after {number}, seed {seed}" for seed in extent.seeds]
    head += [f"Adaptive Modelling after {number}", "all channels"]
    early = extent.told[1]
    head.append(f"secant update with gain 1 after {early}, all channels")
    rows = []
    for share in extent.shares:
        secant = campaign(
            target, model=identified(share, extent.seeds[0]), update=ALGORITHMS[2].settings, playbacks=early
        )
        for gain in extent.gains:
            row = [f"{100.0 * share:g} %", f"{gain:g}"]
            for seed in extent.seeds:
                trial = campaign(
                    target,
                    model=identified(share, seed),
                    update=UpdateSettings(BAND, gain * _ONE, _TWR),
                    playbacks=number,
                )
                row.append(_best_and_last(trial))
            trial = campaign(
                target,
                model=identified(share, extent.seeds[0]),
                update=UpdateSettings(BAND, gain * _ONE, _AM),
                playbacks=number,
            )
            rows.append(
                [*row, f"{trial.longitudinal[-1]:.3f}", f"{trial.overall[-1]:.3f}", f"{secant.overall[-1]:.3f}"]
            )
    return markdown_table(head, rows)


def _best_and_last(trial: Trial) -> str:
    told = f"{trial.longitudinal.min():.2f}, {trial.longitudinal[-1]:.2f}"
    return f"{told} ({trial.stopped})" if trial.stopped else told


if __name__ == "__main__":
    run("figure_7_8_9", study)
